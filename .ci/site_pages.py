# SPDX-License-Identifier: Apache-2.0
"""Hook of the documentation site: pages generated from the code, and links that leave docs/.

mkdocs calls `on_files` and `on_page_markdown`.  The tables are functions of the code alone, so tests read them too.
"""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from mech_twin.cli.main import EXPORTS, QUESTIONS, VERBS
from mech_twin.cli.verb import Excludes, declared, flags_of, in_order
from mech_twin.declarations.quantity import Parameters
from mech_twin.machines.catalog import CATALOGUE, Entry
from mech_twin.machines.page.parameters import Page
from mech_twin.messages.topics import LATCHED, Topic, recorded_topics, type_name
from mech_twin.nodes.exchange.base_node import RunOptions
from mech_twin.parameters.load import machine_parameters
from mech_twin.roles import RESIDUALS, Machine

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = ROOT / "docs" / "notebooks"
REPOSITORY = "https://github.com/mech-twin/mech_twin/blob/main/"
TOP_PAGES = {"README.md": "index.md"} | {name: name for name in ("CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")}
SYMBOLS = ((Ge, "ge", "≥"), (Gt, "gt", ">"), (Le, "le", "≤"), (Lt, "lt", "<"))


def table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """Return a Markdown table."""
    lines = [heads, tuple("---" for _ in heads), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def groups_of(annotation: Any) -> list[type[Parameters]]:
    """Return the parameter models an annotation names, in whatever it is wrapped."""
    if isinstance(annotation, type) and issubclass(annotation, Parameters):
        return [annotation]
    return [model for option in get_args(annotation) for model in groups_of(option)]


def fields_of(model: type[Parameters], prefix: str = "") -> Iterator[tuple[str, FieldInfo]]:
    """Yield every key of a parameter model with its declaration, groups opened."""
    for name, field in model.model_fields.items():
        groups = groups_of(field.annotation)
        if not groups:
            yield prefix + name, field
        for group in groups:
            yield from fields_of(group, f"{prefix}{name}.")


def words_of(annotation: Any) -> list[str]:
    """Return the words a key may have; none where it is a number."""
    found = [word for word in get_args(annotation) if isinstance(word, str)]
    return found or [word for option in get_args(annotation) for word in words_of(option)]


def limits(field: FieldInfo) -> str:
    """Return the legal values of a key: its bounds, or the words it may have."""
    bounds = [
        f"{symbol} {getattr(bound, name):g}"
        for bound in field.metadata
        for kind, name, symbol in SYMBOLS
        if isinstance(bound, kind)
    ]
    return ", ".join(bounds or [f"`{word}`" for word in words_of(field.annotation)])


def parameter_rows(model: type[Parameters]) -> list[tuple[str, ...]]:
    """Return key, unit, legal values, whether it is live, and meaning of every parameter of a model."""
    rows = {}
    for key, field in fields_of(model):
        said = declared(field)
        live = "yes" if said.get("live") else ""
        rows[key] = (f"`{key}`", str(said.get("unit", "")), limits(field), live, field.description or "")
    return list(rows.values())


def parameter_table(model: type[Parameters]) -> str:
    """Return the table of `parameter_rows`."""
    return table(("key", "unit", "legal values", "live", "meaning"), parameter_rows(model))


def default(field: FieldInfo) -> str:
    """Return what holds where a key is left out: a value, nothing, or that it may not be."""
    if field.is_required():
        return "needed"
    return "" if field.default in (None, "", {}) else json.dumps(field.default)


def element_table(model: type[Parameters]) -> str:
    """Return the table of an element's keys: those of `parameter_rows`, and what holds where they are left out."""
    defaults = {f"`{key}`": default(field) for key, field in fields_of(model)}
    rows = [(*row[:3], defaults[row[0]], *row[3:]) for row in parameter_rows(model)]
    return table(("key", "unit", "legal values", "default", "live", "meaning"), rows)


def topic_row(topic: Topic) -> tuple[str, ...]:
    """Return name, type and delivery of a topic."""
    kept = "reliable, transient local" if topic.qos is LATCHED else "reliable"
    return f"`{topic.name}`", type_name(topic), f"{kept}, depth {topic.qos.depth}"


def _residual_rows(machine: Machine) -> list[tuple[str, ...]]:
    rows = []
    for role in (machine.linkage, machine.forces, machine.body):
        for name, limit in (role.residual_limits if role else {}).items():
            known = RESIDUALS.get(name)
            rows.append((f"`{name}`", known.unit if known else "", f"{limit:g}", known.meaning if known else ""))
    return rows


def machine_page(entry: Entry) -> str:
    """Return the reference page of one machine, as installed."""
    machine = entry.build(machine_parameters(entry.name))
    named = [(role, getattr(machine, role)) for role in ("motor", "linkage", "body") if getattr(machine, role)]
    joints = [(role, ", ".join(f"`{joint}`" for joint in part.joints)) for role, part in named]
    regimes = [(role, ", ".join(f"`{word}`" for word in part.regimes)) for role, part in named if role != "motor"]
    pins = list(zip((f"`{pin}`" for pin in machine.forces.pins), machine.forces.acts_on, strict=True))
    topics = recorded_topics(machine.forces.pins, entry.has_body)
    return "\n\n".join(
        [
            f"# `{entry.name}`: interface",
            f"{entry.title[0].upper()}{entry.title[1:]}. Model and sources: [page of the machine]"
            f"(../machines/{entry.name}.md). Generated from the code and the installed configuration.",
            "## Joints",
            table(("role", "joints"), joints),
            "## Regimes",
            table(("role", "names, in the order of the index in `~regime`"), regimes),
            "## Pins",
            "`forces/<pin>` gives the reaction on the link named here.",
            table(("pin", "acts on"), pins),
            "## Topics",
            f"Relative to `/{entry.name}`. What each means: [nodes, topics and services](../topics.md).",
            table(("topic", "type", "quality of service"), [topic_row(topic) for topic in topics]),
            "## Residuals",
            "Zero but for rounding; a value over its limit is an error of the program.",
            table(("name", "unit", "limit", "what it compares"), _residual_rows(machine)),
            "## Parameters",
            "*live*: may be changed while the machine runs, with `ros2 param set`. Groups that exclude each other are "
            "all listed.",
            parameter_table(type(machine.parameters)),
            "",
        ]
    )


def elements_page() -> str:
    """Return the reference of a page's elements, made from their models."""
    parts = [
        "# Elements of a page",
        "Generated from the code. How a page is written: [a machine from a page](../pages.md). `NAME` is yours. "
        "*needed*: not to be left out, of `group.key` where its group is there.",
    ]
    alone: list[tuple[str, ...]] = []
    for group, field in Page.model_fields.items():
        models = groups_of(field.annotation)
        extra = field.json_schema_extra
        unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
        if not models:
            alone.append((f"`{group}`", unit, field.description or ""))
            continue
        named = ".NAME" if get_origin(field.annotation) is dict else ""
        parts += [f"## `{group}{named}`", f"{(models[0].__doc__ or '').strip()}", element_table(models[0])]
    parts[2:2] = ["## Of the whole machine", table(("key", "unit", "meaning"), alone)]
    return "\n\n".join([*parts, ""])


def services() -> list[tuple[str, str, str]]:
    """Return each service that a node creates: its name, its type, and the module that creates it."""
    found = []
    for file in sorted((ROOT / "mech_twin" / "nodes").rglob("*_node*.py")):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
        for call in calls:
            if ast.unparse(call.func) in ("offer", "self.create_service"):
                *_, kind, name, _ = call.args
                found.append((ast.literal_eval(name), f"std_srvs/srv/{ast.unparse(kind)}", f"`{file.stem}`"))
    return found


def run_page() -> str:
    """Return the page of what every node has: the group ``run`` and the services."""
    return "\n\n".join(
        [
            "# Options of a run, and services",
            "## Parameters `run.*`",
            "Read by every node when it starts; `mech-twin run --set run.KEY=VALUE` sets them.",
            parameter_table(RunOptions),
            "## Services",
            "`~` is the name of the node.",
            table(("service", "type", "executable"), [(f"`{name}`", kind, node) for name, kind, node in services()]),
            "",
        ]
    )


def verbs_page() -> str:
    """Return the page of every verb with its options, made from their declarations."""
    parts = ["# Verbs and their options", "Generated from the declarations that the command line is made of."]
    groups = (("mech-twin ", VERBS), ("mech-twin study MACHINE ", QUESTIONS), ("mech-twin export ", EXPORTS))
    for before, (name, verb) in ((before, item) for before, verbs in groups for item in verbs.items()):
        rows = []
        for field_name, field in in_order(verb).items():
            said = declared(field)
            written = said.get("metavar") or field_name.upper()
            if said and not said.get("argument"):
                written = " ".join(filter(None, (flags_of(field_name, field)[0], said.get("metavar"))))
            absent = "" if field.is_required() else said.get("shown") or field.default
            shown = "" if absent in (None, False, []) else str(absent)
            rows += [(f"`{written}`", shown, limits(field), field.description or "")] if said else []
        rules = [
            f"- `{flags_of(rule.first, verb.model_fields[rule.first])[0]}` excludes "
            f"`{flags_of(rule.second, verb.model_fields[rule.second])[0]}`: {rule.why}"
            for rule in verb.rules
            if isinstance(rule, Excludes)
        ]
        parts += [
            f"## {before}{name}",
            verb.__doc__ or "",
            table(("option", "default", "legal values", "meaning"), rows),
        ]
        parts += ["\n".join(rules)] if rules else []
    return "\n\n".join([*parts, ""])


def notebook_page(path: Path) -> str:
    """Return a notebook as a page: its text, its code, and what each cell showed."""
    parts = []
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            shown = "".join(output.get("data", output).get("text/plain", output.get("text", ())))
            parts += [f"```text\n{shown.rstrip()}\n```"] if shown.strip() else []
    parts.append(f"[The notebook itself]({REPOSITORY}{path.relative_to(ROOT).as_posix()}), to be run.")
    return "\n\n".join(parts) + "\n"


def generated_pages() -> dict[str, str]:
    """Return every generated page by its path below docs/."""
    pages = {f"reference/{entry.name}.md": machine_page(entry) for entry in CATALOGUE.values()}
    copies = {page: (ROOT / name).read_text(encoding="utf-8") for name, page in TOP_PAGES.items()}
    notebooks = {f"notebooks/{path.stem}.md": notebook_page(path) for path in sorted(NOTEBOOKS.glob("*.ipynb"))}
    return {
        **pages,
        "reference/verbs.md": verbs_page(),
        "reference/run.md": run_page(),
        "reference/page.md": elements_page(),
        **copies,
        **notebooks,
    }


def on_files(files: Any, config: Any) -> Any:
    """Add the generated pages to the site."""
    from mkdocs.structure.files import File

    for path, text in generated_pages().items():
        files.append(File.generated(config, path, content=text))
    return files


def relinked(markdown: str, source: str) -> str:
    """Return a page whose links out of docs/ lead to the page of the site, or to the file in the repository."""
    folder = ROOT if source in TOP_PAGES.values() else (ROOT / "docs" / source).parent

    def target(match: re.Match[str]) -> str:
        path, anchor = match.group(1), match.group(2) or ""
        file = (folder / path).resolve()
        if not file.exists() or ROOT not in file.parents:
            return match.group(0)  # mkdocs names it: a broken link, or a generated page
        name = file.relative_to(ROOT).as_posix()
        if name in TOP_PAGES:
            return f"]({'../' * source.count('/')}{TOP_PAGES[name]}{anchor})"
        if file.suffix == ".ipynb":
            name = file.with_suffix(".md").relative_to(ROOT).as_posix()
            return f"]({'../' * source.count('/')}{name.removeprefix('docs/')}{anchor})"
        if name.startswith("docs/") and file.is_file():
            return f"]({'../' * source.count('/')}{name.removeprefix('docs/')}{anchor})"
        return f"]({REPOSITORY}{name}{anchor})"

    return re.sub(r"\]\((?!\w+:)([^)#\s]+)(#[^)\s]*)?\)", target, markdown)


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Mend links and titles of code blocks of a page before it is rendered."""
    titled = re.sub(r"^```(\w+) (?:file|line)=(\S+)$", r'```\1 title="\2"', markdown, flags=re.MULTILINE)
    return relinked(titled, page.file.src_uri)
