# SPDX-License-Identifier: Apache-2.0
"""What the package imports it declares, and nothing else; what is lacking is said in one line."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from importlib.metadata import PackageNotFoundError, packages_distributions
from pathlib import Path
from xml.etree import ElementTree

import pytest

from mech_twin.process.dependencies import EXTRA_OF, missing_extra, unmet

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "mech_twin"
ROS_EXTRAS = ("jazzy", "kilted")
DEVELOPER_EXTRAS = ("test", "bench", "docs")
# distribution -> rosdep key; the rest of what is required has none and is named in docs/native.md
ROSDEP = {
    "numpy": "python3-numpy",
    "scipy": "python3-scipy",
    "numba": "python3-numba",
    "pydantic": "python3-pydantic",
    "pyyaml": "python3-yaml",
    "typer": "python3-typer",
    "rich": "python3-rich",
}


def canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def called(function: ast.expr) -> str:
    return getattr(function, "attr", getattr(function, "id", ""))


def imports(tree: ast.AST, *, deferred: bool = False) -> Iterator[tuple[str, bool]]:
    """Yield each root package that is imported, and whether only when a function is called or types are checked."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name.partition(".")[0], deferred) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
            yield node.module.partition(".")[0], deferred
        inside = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) or (
            isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        )
        yield from imports(node, deferred=deferred or inside)
    if isinstance(tree, ast.Call) and called(tree.func) in ("import_module", "find_spec") and tree.args:
        named = tree.args[0]
        if isinstance(named, ast.Constant) and isinstance(named.value, str):
            yield named.value.partition(".")[0], True


@cache
def third_party() -> dict[str, set[Path]]:
    """Return each foreign package and the files that import it."""
    found: dict[str, set[Path]] = {}
    for file in PACKAGE.rglob("*.py"):
        for name, _ in imports(ast.parse(file.read_text(encoding="utf-8"))):
            if name not in sys.stdlib_module_names and name != "mech_twin":
                found.setdefault(name, set()).add(file)
    return found


def requirements() -> dict[str, list[str]]:
    """Return what setup.py requires: of every installation under "", the rest by extra."""
    tree = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8"))
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "setup")
    arguments = {word.arg: word.value for word in next(calls).keywords}
    return {"": ast.literal_eval(arguments["install_requires"]), **ast.literal_eval(arguments["extras_require"])}


def declared() -> dict[str, set[str]]:
    """Return the distributions of each group."""
    return {
        group: {canonical(re.split(r"[\[>=<]", text)[0]) for text in listed} for group, listed in requirements().items()
    }


def manifest(tag: str) -> set[str]:
    return {str(item.text) for item in ElementTree.parse(ROOT / "package.xml").getroot().findall(tag)}


@cache
def installed() -> dict[str, list[str]]:
    """Return the distributions that bring each package; reading them all takes a good part of a second."""
    return dict(packages_distributions())


def distributions(name: str) -> set[str]:
    return {canonical(found) for found in installed().get(name, [])}


DECLARED = declared()
REQUIRED = requirements()[""]
FROM_PIP = set().union(*(names for group, names in DECLARED.items() if group not in ROS_EXTRAS + DEVELOPER_EXTRAS))


def of_ros(name: str) -> bool:
    return name.endswith(("_msgs", "_srvs", "_interfaces")) or name == "rclpy"


def test_the_scan_sees_what_is_known_to_be_imported() -> None:
    assert {"numpy", "numba", "rclpy", "rerun", "aiohttp", "distributed", "lz4"} <= set(third_party())


def test_every_import_is_of_a_declared_distribution() -> None:
    others = {name: files for name, files in third_party().items() if not of_ros(name)}
    assert {name: files for name, files in others.items() if not distributions(name) & FROM_PIP} == {}


def test_every_ros_package_imported_is_in_the_manifest() -> None:
    assert set(filter(of_ros, third_party())) <= manifest("exec_depend")


def test_every_declared_distribution_is_imported() -> None:
    used = set().union(*map(distributions, third_party()))
    assert FROM_PIP - used == set(), "only tests import them, or nothing does"


@pytest.mark.parametrize("name", sorted(EXTRA_OF))
def test_what_an_extra_brings_is_imported_only_where_it_is_used(name: str) -> None:
    """A program that does without the extra starts and works: the modules of its own verbs load none of it."""
    extra = DECLARED[EXTRA_OF[name]]
    assert distributions(name) & extra
    assert not distributions(name) & DECLARED[""]


def test_manifest_names_every_key_that_rosdep_has() -> None:
    assert set(ROSDEP) <= DECLARED[""]
    assert {ROSDEP[name] for name in ROSDEP} <= manifest("exec_depend")


def test_what_rosdep_lacks_stands_in_the_page_on_native_installation() -> None:
    page = (ROOT / "docs" / "native.md").read_text(encoding="utf-8")
    command = re.search(r"^pip install ('.+)$", page, re.MULTILINE)
    assert command is not None
    named = {word.strip("'") for word in command.group(1).split()}
    assert {canonical(re.split(r">=", word)[0]) for word in named} >= DECLARED[""] - set(ROSDEP)
    assert named <= set(REQUIRED), "a bound differs from that of setup.py"


HEADLESS = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {names!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Absent())
"""
COMMAND = "from mech_twin.cli.main import main; main()"


def without_extras(*words: str, cwd: Path, script: str = COMMAND) -> subprocess.CompletedProcess[str]:
    script = HEADLESS.format(names=sorted(EXTRA_OF)) + script
    command = [sys.executable, "-c", script, *words]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=120, check=False)


def test_no_verb_needs_an_extra_before_it_is_asked_for(tmp_path: Path) -> None:
    shown = {PACKAGE / "view", PACKAGE / "nodes" / "run"}  # servers and scenes of the browser
    files = [file for file in sorted(PACKAGE.rglob("[!_]*.py")) if not shown & set(file.parents)]
    modules = [".".join(file.relative_to(ROOT).with_suffix("").parts) for file in files]
    assert len(modules) > 250
    done = without_extras(cwd=tmp_path, script="\n".join(f"import {module}" for module in modules))
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_machine_is_simulated_without_any_extra(tmp_path: Path) -> None:
    done = without_extras("simulate", "winding_drum", "--duration", "0.05", "--bag", "bag", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "bag" / "metadata.yaml").is_file()


@pytest.mark.slow
@pytest.mark.parametrize(
    "words", [("reproduce", "winding_drum"), ("study", "compaction_press", "size", "--tolerance", "0")]
)
def test_a_study_that_draws_nothing_needs_no_extra(words: tuple[str, ...], tmp_path: Path) -> None:
    done = without_extras(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_a_machine_is_run_over_topics_without_any_extra(ros_domain: int, tmp_path: Path) -> None:
    words = ("run", "winding_drum", "--duration", "0.05", "--pace", "max", "--view", "none", "--record", "bag")
    done = without_extras(*words, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "bag" / "metadata.yaml").is_file()


BROKEN_AT = ("--duration", "1", "--set", "stop.model=wave", "--set", "stop.wave.life.amplitude_pa=2e8")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "extra"),
    [
        (("reproduce", "winding_drum", "--figures", "drawn"), "plots"),
        (("study", "winding_drum", "sweep", "--over", "eccentricity_m=0:0.01:3"), "tables"),
        (("study", "winding_drum", "sweep", "--over", "eccentricity_m=0:0.01:3", "--out", "s.csv"), "plots"),
        (("study", "impact_mass", "regimes", "--over", "force.period_s=0.1:0.2:2"), "plots"),
        (("study", "compaction_press", "designs", "--count", "10", "--out", "d.parquet"), "tables"),
        (("run", "winding_drum", "--duration", "0.1", "--no-record"), "view"),
        (("run", "winding_drum", "--duration", "0.1", "--no-record", "--view", "run.rrd", "--processes"), "view"),
        (("view", "bag", "--save", "bag.rrd"), "view"),
        (("simulate", "impact_mass", *BROKEN_AT), "life"),
    ],
)
def test_a_verb_that_needs_a_missing_extra_says_so_in_one_line(
    words: tuple[str, ...], extra: str, tmp_path: Path
) -> None:
    if words[0] == "view":
        without_extras("simulate", "winding_drum", "--duration", "0.05", "--bag", "bag", cwd=tmp_path)
    done = without_extras(*words, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == f"mech-twin: needs the extra '{extra}': pip install 'mech_twin[{extra}]'\n"


def test_an_import_that_fails_within_the_package_keeps_its_trace() -> None:
    assert missing_extra(ModuleNotFoundError("no", name="mech_twin.gone")) is None
    assert missing_extra(ImportError("cannot import name", name="rerun")) is None
    assert missing_extra(ModuleNotFoundError("no", name="rerun.blueprint")) is not None


def test_old_and_missing_packages_are_named_with_what_was_found() -> None:
    versions = {"pydantic": "1.10.14", "typer": "0.26.0", "rich": "14.0.0rc1"}

    def installed(name: str) -> str:
        if name not in versions:
            raise PackageNotFoundError(name)
        return versions[name]

    found = unmet(["pydantic>=2.7", "typer>=0.26", "rich>=13.7", "lz4>=4", 'rerun-sdk>=9; extra == "view"'], installed)
    assert found == ["pydantic 2.7 or newer (found 1.10.14)", "lz4 4 or newer (not installed)"]


@pytest.mark.slow
@pytest.mark.parametrize("start", ["mech_twin.cli.main", "mech_twin.nodes.run.executables"])
def test_a_start_with_an_old_package_ends_in_one_line(start: str) -> None:
    script = (
        "import importlib.metadata as m; real = m.version\n"
        "m.version = lambda name: '1.10.14' if name == 'pydantic' else real(name)\n"
        "m.requires = lambda name: ['pydantic>=2.7', 'numpy>=1']\n"
        f"import {start}\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr == "mech_twin: needs pydantic 2.7 or newer (found 1.10.14): pip install 'pydantic>=2.7'\n"
