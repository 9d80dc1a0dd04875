# SPDX-License-Identifier: Apache-2.0
"""What the pages name exists, and what the code names stands in the pages."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
import typer
import yaml
from ci_scripts import ci_script

from mech_twin.cli.main import app
from mech_twin.cli.run_summary import grouped, headlines
from mech_twin.engine import crank_motion
from mech_twin.engine.coupling import RESET
from mech_twin.engine.run import frames
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.machines.impact_mass.dynamics import KIND_NAMES
from mech_twin.machines.mb10_breaker.pressed_body.collar_contact import CAUSES
from mech_twin.machines.mb10_breaker.pressed_body.collar_contact import REGIMES as HALF_SINE_REGIMES
from mech_twin.machines.mb10_breaker.state import KINDS as BREAKER_KINDS
from mech_twin.machines.roller_former.motion import EVENT_KINDS
from mech_twin.messages import topics
from mech_twin.nodes.exchange.counting import KINDS as COUNTED
from mech_twin.parameters.errors import keys
from mech_twin.parameters.load import machine_parameters
from mech_twin.roles import RESIDUALS

ROOT = Path(__file__).resolve().parents[2]
PAGES = [
    *sorted((ROOT / "docs").rglob("*.md")),
    *(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "SECURITY")),
]
ROOMS = ("mech_twin", "docs", "config", "test", "benchmarks", "constraints", "bags", ".ci", "launch", ".github")
# what the recipes docs/adding-a-machine.md, -topic.md and -metric.md make
EXAMPLES = ("flywheel_rig", "regime_name", "test_drive_power_max")
MADE_ON_DEMAND = re.compile(r"[*<>{}]|[A-Z]{3}")  # a placeholder, not a path
TOP = typer.main.get_command(app)


SITE = ci_script("site_pages")


def page(name: str) -> str:
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def first_column(section: str) -> set[str]:
    """Return the names in code type in the first column of the table under a heading of docs/topics.md."""
    body = page("topics.md").split(f"\n## {section}\n")[1].split("\n## ")[0]
    cells = [line.split("|")[1] for line in body.splitlines() if line.startswith("|")]
    return {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)}


def test_topics_page_has_the_topics_of_the_code_and_no_other() -> None:
    named = {value.name for value in vars(topics).values() if isinstance(value, topics.Topic)}
    assert len(named) > 10
    of_shadow = {name for name in named if name.startswith(f"{topics.TWIN}/")}
    assert first_column("Topics") == named - of_shadow | {topics.pin_wrench("<pin>").name}
    assert first_column("Topics of a shadow") == of_shadow | {topics.virtual_pin("<pin>").name}


def test_topics_page_has_the_services_of_the_nodes_and_no_other() -> None:
    of_ros = {"linkage/set_parameters"}
    created = {name for name, _, node in SITE.services() if node != "`replay_node`"}
    assert created
    assert first_column("Services") == created | of_ros


@pytest.mark.parametrize("name", CATALOGUE)
def test_interface_page_has_every_parameter_of_the_installed_configuration(name: str) -> None:
    parameters = machine_parameters(name)
    rows = {row[0].strip("`"): row for row in SITE.parameter_rows(type(parameters))}
    for key in keys(parameters):
        extra = key.field.json_schema_extra
        assert isinstance(extra, dict)
        _, unit, _, live, meaning = rows[key.name]
        assert (unit, meaning) == (extra.get("unit", ""), key.field.description)
        assert (live == "yes") == key.live


def test_interface_page_shows_the_bounds_that_are_enforced() -> None:
    row = next(row for row in SITE.parameter_rows(SITE.RunOptions) if row[0] == "`view_rate_hz`")
    assert row[1:3] == ("Hz", "≥ 1e-06, ≤ 1000")


def menu(entries: object) -> Iterator[str]:
    if isinstance(entries, str):
        yield entries
    elif isinstance(entries, dict):
        for value in entries.values():
            yield from menu(value)
    elif isinstance(entries, list):
        for value in entries:
            yield from menu(value)


def test_every_page_is_in_the_menu_of_the_site_once() -> None:
    listed = sorted(menu(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]))
    written = {file.relative_to(ROOT / "docs").as_posix() for file in (ROOT / "docs").rglob("*.md")}
    made = {f"reference/{name}.md" for name in (*CATALOGUE, "run", "page", "verbs")} | set(SITE.TOP_PAGES.values())
    made |= {f"notebooks/{path.stem}.md" for path in SITE.NOTEBOOKS.glob("*.ipynb")}
    assert listed == sorted(written | made)


def paths_in(text: str) -> set[str]:
    """Return the words of a page that have the form of a path in the repository, and bare names of Python files."""
    rooms = "|".join(re.escape(room) for room in ROOMS)
    rooted = re.findall(rf"(?<![\w/.$~-])((?:{rooms})/[\w./*<>{{}}-]*)", text)
    bare = re.findall(r"`([a-z]\w+\.py)`", text)
    return {
        path.rstrip(".")
        for path in (*rooted, *bare)
        if not MADE_ON_DEMAND.search(path) and not any(e in path for e in EXAMPLES)
    }


@pytest.mark.parametrize("file", PAGES, ids=lambda file: str(file.relative_to(ROOT)))
def test_every_path_a_page_names_exists(file: Path) -> None:
    for path in paths_in(file.read_text(encoding="utf-8")):
        below_package = ROOT / "mech_twin" / path  # `engine/events.py` in a page on the package
        found = (ROOT / path).exists() or below_package.exists() or any(ROOT.glob(f"[mtb]*/**/{path}"))
        assert found, f"{file.name} names {path}, which does not exist"


@pytest.mark.parametrize("file", PAGES, ids=lambda file: str(file.relative_to(ROOT)))
def test_every_relative_link_of_a_page_leads_to_a_file(file: Path) -> None:
    made = {f"{name}.md" for name in (*CATALOGUE, "run", "page", "verbs")}
    for link in re.findall(r"\]\((?!\w+:)([^)#\s]+)", file.read_text(encoding="utf-8")):
        target = (file.parent / link).resolve()
        generated = target.parent == ROOT / "docs" / "reference" and target.name in made
        assert target.exists() or generated, f"{file.name} links to {link}"


def command_lines(text: str) -> list[list[str]]:
    """Return each ``mech-twin`` command of a page, in a block or between backticks, as words."""
    inline = re.findall(r"`(mech-twin [^`\n]+)`", text)
    blocks = re.findall(r"^(?: {4})?(?:\$ )?(?:\.venv/bin/)?(mech-twin [^|#\n]+)", text, re.MULTILINE)
    return [line.replace("[", " ").replace("]", " ").split()[1:] for line in (*inline, *blocks)]


def command_named(words: list[str]) -> click.Command:
    """Return the command that words of a page call.

    Raises
    ------
    KeyError
        If there is none.
    """
    command: click.Command = TOP
    rest = [word for word in words if not word.startswith("-")]
    if rest:
        command = TOP.commands[rest[0]]  # type: ignore[attr-defined]
    if rest[:1] == ["study"] and len(rest) > 2 and not rest[2].isupper():
        command = command.commands[rest[2]]  # type: ignore[attr-defined]
    if rest[:1] == ["export"]:
        command = command.commands[rest[1]]  # type: ignore[attr-defined]
    return command


@pytest.mark.parametrize("file", PAGES, ids=lambda file: str(file.relative_to(ROOT)))
def test_every_command_a_page_names_exists_with_its_options(file: Path) -> None:
    for words in command_lines(file.read_text(encoding="utf-8")):
        command = command_named(words)
        options = {name for parameter in command.params for name in parameter.opts} | {"--help"}
        asked = {word.partition("=")[0] for word in words if word.startswith("--")}
        assert asked <= options, f"{file.name}: mech-twin {' '.join(words)}"


def test_a_command_that_does_not_exist_is_found() -> None:
    for wrong in ("`mech-twin guard BAG`", "    mech-twin study mb10_breaker identify"):
        with pytest.raises(KeyError):
            command_named(command_lines(wrong)[0])
    assert paths_in("see `engine/gone.py`, mech_twin/engine/gone.py") == {"mech_twin/engine/gone.py"}


@pytest.mark.parametrize("file", PAGES, ids=lambda file: str(file.relative_to(ROOT)))
def test_every_make_target_a_page_names_exists(file: Path) -> None:
    rules = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = {name for line in re.findall(r"^\.PHONY: (.+)$", rules, re.MULTILINE) for name in line.split()}
    assert set(re.findall(r"`make ([a-z][\w-]*)", file.read_text(encoding="utf-8"))) <= targets


PRESS_BOUNDARIES = {"contact", "top", "bottom", "release"}
WORDS = {
    "regime": {
        *(word for entry in CATALOGUE.values() for word in entry.build(machine_parameters(entry.name)).linkage.regimes),
        *HALF_SINE_REGIMES,
    },
    "event": {
        *(*KIND_NAMES, *CAUSES, *BREAKER_KINDS, *EVENT_KINDS, *PRESS_BOUNDARIES, RESET),
        *crank_motion.KINDS,
    },
    "residual": set(RESIDUALS),
    "counter": set(COUNTED),
}


@pytest.mark.parametrize(("kind", "word"), [(kind, word) for kind in WORDS for word in sorted(WORDS[kind])])
def test_glossary_explains_every_name_a_run_shows(kind: str, word: str) -> None:
    assert re.search(rf"^\| [^|]*`{re.escape(word)}`", page("glossary.md"), re.MULTILINE), f"{kind} {word}"


def run_numbers(name: str, duration_s: float) -> dict[str, float]:
    machine = CATALOGUE[name].build(machine_parameters(name))
    observer = machine.observer()
    for frame in frames(machine, duration_s):
        observer.observe(frame)
    return dict(observer.numbers())


@pytest.mark.parametrize("name", CATALOGUE)
def test_glossary_explains_every_headline_of_a_run(name: str) -> None:
    table = page("glossary.md").partition("## Headline metrics")[2].partition("\n## ")[0]
    explained = {word for row in table.splitlines() if row.startswith("| `") for word in re.findall(r"`(\w+)`", row)}
    shown = {key for group, own in grouped(run_numbers(name, 0.6)).items() for key in headlines(own, group)}
    assert shown
    assert shown <= explained


def test_the_first_table_of_the_quick_start_is_shown_without_asking_for_all() -> None:
    table = page("quick-start.md").split("| metric |")[1].split("\n\n")[0]
    named = set(re.findall(r"^\| `(\w+)`", table, re.MULTILINE))
    shown = {key for group, own in grouped(run_numbers("mb10_breaker", 0.6)).items() for key in headlines(own, group)}
    assert len(named) == 5
    assert named - {"steady_settled_at_fraction"} <= shown  # not yet in so short a run


def test_every_notebook_is_a_page_of_the_site_with_its_code_and_what_it_showed() -> None:
    pages = SITE.generated_pages()
    for path in (ROOT / "docs" / "notebooks").glob("*.ipynb"):
        made, cells = pages[f"notebooks/{path.stem}.md"], json.loads(path.read_text(encoding="utf-8"))["cells"]
        assert made.count("```python") == sum(cell["cell_type"] == "code" for cell in cells)
        assert "```text" in made
        assert f"notebooks/{path.stem}.md" in (ROOT / "mkdocs.yml").read_text(encoding="utf-8")


def test_no_page_holds_formulas_that_the_site_does_not_set() -> None:
    held = [path.name for path in (ROOT / "docs").rglob("*.md") if "$$" in path.read_text(encoding="utf-8")]
    assert held == []


@pytest.mark.slow
def test_quick_start_names_metrics_that_a_run_has() -> None:
    text = page("quick-start.md")
    table = text.split("| metric |")[1].split("\n\n")[0]
    named = set(re.findall(r"^\| `(\w+)`", table, re.MULTILINE)) | set(re.findall(r"--number (\w+)", text))
    machine = CATALOGUE["mb10_breaker"].build(machine_parameters("mb10_breaker"))
    observer = machine.observer()
    for frame in frames(machine, 1.0):
        observer.observe(frame)
    assert len(named) > 5
    assert named <= {*machine.report(), *observer.numbers()}


def test_tutorials_done_one_after_the_other_write_no_file_twice() -> None:
    """What exists already is not overwritten unasked: the second tutorial would stop there."""
    pages = [*sorted((ROOT / "docs" / "tutorials").glob("*.md")), ROOT / "docs" / "quick-start.md"]
    written: dict[str, str] = {}
    for page in pages:
        for name in set(re.findall(r"--(?:table|out|record|bag|save) (\S+)", page.read_text(encoding="utf-8"))):
            assert name not in written, f"{page.name} writes {name}, as {written[name]} does"
            written[name] = page.name
