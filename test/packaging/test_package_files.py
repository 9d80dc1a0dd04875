# SPDX-License-Identifier: Apache-2.0
"""The files ROS installations read: manifest, launch file, entry points, pins."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from importlib.metadata import entry_points
from pathlib import Path
from xml.etree import ElementTree

import pytest

from mech_twin import __version__
from mech_twin import programs as programs_module
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.nodes.run import executables
from mech_twin.nodes.run.executables import LaunchRequest, programs
from mech_twin.parameters.load import MACHINE_KEY, file_tree

ROOT = Path(__file__).resolve().parents[2]
LAUNCH = ROOT / "launch" / "twin.launch.py"
NODES = {"motor_node", "linkage_node", "force_node", "body_node", "frames_node", "recorder_node", "viewer_node"}


def launch_calls(name: str) -> list[ast.Call]:
    tree = ast.parse(LAUNCH.read_text(encoding="utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.Call) and getattr(node.func, "id", "") == name]


def test_manifest_is_format_3_ament_python_and_of_this_version() -> None:
    package = ElementTree.parse(ROOT / "package.xml").getroot()
    assert package.get("format") == "3"
    assert package.findtext("export/build_type") == "ament_python"
    assert (ROOT / str(package.findtext("export/rosdoc2"))).is_file()
    assert package.findtext("version") == __version__
    assert {"rclpy", "sensor_msgs", "diagnostic_msgs"} <= {item.text for item in package.findall("exec_depend")}


def test_launch_file_compiles_and_declares_its_arguments() -> None:
    compile(LAUNCH.read_text(encoding="utf-8"), str(LAUNCH), "exec")
    calls = launch_calls("DeclareLaunchArgument")
    declared = {call.args[0].value for call in calls}  # type: ignore[attr-defined]
    chosen = {
        call.args[0].value  # type: ignore[attr-defined]
        for call in calls
        if any(word.arg == "choices" for word in call.keywords)
    }
    assert declared == {*LaunchRequest._fields, "discovery", "respawn"}
    assert chosen == {"pace", "use_sim_time", "discovery", "respawn", "frames"}


def test_launch_file_starts_programs_that_are_installed() -> None:
    request = LaunchRequest("mb10_breaker", record="DIR", view="run.rrd")
    named = {program.executable for program in programs(request)}
    installed = {entry.name for entry in entry_points(group="console_scripts") if entry.value.startswith("mech_twin.")}
    assert named == NODES
    assert NODES | {"mech-twin"} <= installed


def test_every_program_can_be_loaded() -> None:
    for entry in entry_points(group="console_scripts"):
        if entry.value.startswith("mech_twin."):
            assert callable(entry.load())


def test_every_program_begins_where_a_signal_is_answered_first() -> None:
    text = (ROOT / "setup.py").read_text(encoding="utf-8")
    assert '"mech-twin = mech_twin.programs:command"' in text
    assert 'f"{node} = mech_twin.programs:{node}"' in text
    assert callable(programs_module.command)
    for node in NODES:
        assert callable(getattr(programs_module, node)), node
        assert callable(getattr(executables, node)), node


@pytest.mark.parametrize("name", list(CATALOGUE))
def test_a_parameter_file_says_which_machine_it_is_of(name: str) -> None:
    assert file_tree(ROOT / "config" / f"{name}.yaml")[MACHINE_KEY] == name


@pytest.mark.parametrize("file", sorted((ROOT / "constraints").glob("*.txt")), ids=lambda path: path.stem)
def test_pins_are_exact_and_carry_no_address(file: Path) -> None:
    for line in file.read_text(encoding="utf-8").splitlines():
        if line and not line.startswith("#"):
            assert re.fullmatch(r"[A-Za-z0-9._-]+==([0-9]+!)?[A-Za-z0-9.]+", line), line


def test_no_package_is_pinned_twice_in_one_environment() -> None:
    """The site is built in the environment of the tests: two versions of one package end its set-up."""
    for line in ("jazzy", "kilted"):
        texts = [
            (ROOT / "constraints" / f"{name}.txt").read_text(encoding="utf-8") for name in ("python", line, "docs")
        ]
        names = [name.lower().replace("_", "-") for text in texts for name in re.findall(r"^([\w.-]+)==", text, re.M)]
        assert len(names) == len(set(names))


def test_what_make_leaves_beside_the_package_changes_no_verdict_of_lint(tmp_path: Path) -> None:
    """As `make run` and then `make test`: a directory of recordings is no package whose imports are sorted apart."""
    read = ROOT / "test" / "cli" / "test_outputs.py"
    assert "from recordings import" in read.read_text(encoding="utf-8")
    shutil.copy2(ROOT / "pyproject.toml", tmp_path)
    (tmp_path / "test").mkdir()
    shutil.copy2(read, tmp_path / "test")
    for made in ("recordings", "build", "install", "log"):
        (tmp_path / made).mkdir()
    command = [sys.executable, "-m", "ruff", "check", "--no-cache", "--select", "I", "."]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
