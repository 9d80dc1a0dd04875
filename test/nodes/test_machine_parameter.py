# SPDX-License-Identifier: Apache-2.0
"""Which machine a node is of is a parameter: resolved by rcl for the node's name, read-only, without default."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
import rclpy
import yaml
from bench_run import BenchRun
from catalogue import PAGES
from command_line import mech_twin
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.signals import SignalHandlerOptions

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.nodes.exchange.base_node import RunOptions, TwinNode
from mech_twin.nodes.roles.answering_nodes import MotorNode
from mech_twin.nodes.run.composition import _parameter_file
from mech_twin.nodes.run.executables import machine_of
from mech_twin.parameters.load import configuration_file, machine_parameters

pytestmark = pytest.mark.usefixtures("ros_domain")
DRUM = "winding_drum"


def section(tmp_path: Path, **sections: Mapping[str, str | float]) -> Path:
    path = tmp_path / "parameters.yaml"
    document = {name.replace("__", "/"): {"ros__parameters": dict(tree)} for name, tree in sections.items()}
    path.write_text(yaml.safe_dump(document, sort_keys=False))
    return path


@pytest.mark.parametrize(
    ("arguments", "sections", "expected"),
    [
        (["-p", f"machine:={DRUM}"], {}, DRUM),
        (["--param", f"machine:={DRUM}"], {}, DRUM),
        ([], {"__**": {"machine": DRUM}}, DRUM),
        ([], {f"__{DRUM}__motor": {"machine": DRUM}}, DRUM),
        ([], {"__**__motor": {"machine": DRUM}, "__**__linkage": {"machine": "impact_mass"}}, DRUM),
        (["-r", "__ns:=/hall"], {"__hall__motor": {"machine": DRUM}}, DRUM),
        ([], {"__impact_mass__linkage": {"machine": "impact_mass"}, f"__{DRUM}__motor": {"machine": DRUM}}, DRUM),
    ],
)
def test_the_machine_is_resolved_as_rcl_does(
    arguments: list[str], sections: dict[str, dict[str, str]], expected: str, tmp_path: Path
) -> None:
    files = ["--params-file", str(section(tmp_path, **sections))] if sections else []
    rclpy.init(args=["node", "--ros-args", *files, *arguments], signal_handler_options=SignalHandlerOptions.NO)
    try:
        with machine_of("motor") as found:
            assert found == (expected, None)
    finally:
        rclpy.try_shutdown()


@pytest.mark.parametrize("told", [[], ["-p", "machine:=no_such"], ["-p", "other_node:machine:=winding_drum"]])
def test_no_machine_or_none_of_the_catalogue_is_refused_in_words(told: list[str]) -> None:
    rclpy.init(args=["node", "--ros-args", *told], signal_handler_options=SignalHandlerOptions.NO)
    try:
        with pytest.raises(ConfigurationError, match="machine"), machine_of("motor"):
            pass
    finally:
        rclpy.try_shutdown()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("node", "told", "words"),
    [
        ("motor", [], "key 'machine' is not set"),
        ("body", ["machine:=winding_drum"], "machine winding_drum has no moving body"),
        (
            "motor",
            ["machine:=winding_drum", "run.peer_timeout_s:=-1.0"],
            "run group: key 'peer_timeout_s', value -1.0: input should be greater than or equal to 0.000000001 s",
        ),
        ("motor", ["machine:=winding_drum", "drum_inertia_kg_m2:=-1.0"], "-1.0: input should be greater"),
    ],
)
def test_a_node_that_cannot_be_made_ends_with_one_line(node: str, told: list[str], words: str) -> None:
    code = f"from mech_twin.nodes.run.executables import {node}_node; {node}_node()"
    asked = [sys.executable, "-c", code, "--ros-args", *(word for key in told for word in ("-p", key))]
    run = subprocess.run(asked, capture_output=True, text=True, timeout=60, env=os.environ.copy(), check=False)
    assert run.returncode == 2
    assert len(run.stderr.strip().splitlines()) == 1
    assert words in run.stderr


def test_the_machine_can_be_read_and_not_be_set() -> None:
    with BenchRun(DRUM) as run:
        got = run.call(GetParameters, "motor/get_parameters", GetParameters.Request(names=["machine"]))
        assert got.values[0].string_value == DRUM
        assert not run.set_parameters("linkage", machine="impact_mass")[0].successful
        request = DescribeParameters.Request(names=["machine", "run.pace"])
        machine, pace = run.call(DescribeParameters, "motor/describe_parameters", request).descriptors
        assert machine.read_only
        assert DRUM in machine.additional_constraints
        assert "realtime, max" in pace.description


def dumped(run: BenchRun, node: str) -> dict[str, object]:
    """Return every parameter of a node as ``ros2 param dump`` writes it: nested, ROS's own keys among them."""
    names = run.call(ListParameters, f"{node}/list_parameters", ListParameters.Request()).result.names
    target = run.node(node)
    tree: dict[str, object] = {}
    for name in names:
        *groups, last = name.split(".")
        branch = tree
        for group in groups:
            branch = branch.setdefault(group, {})  # type: ignore[assignment]
        value = target.get_parameter(name).value
        branch[last] = list(value) if hasattr(value, "tolist") or isinstance(value, tuple) else value
    return tree


def test_a_dumped_parameter_file_starts_the_same_node_and_the_engine(tmp_path: Path) -> None:
    with BenchRun(DRUM) as run:
        tree = dumped(run, "motor")
    assert "use_sim_time" in tree
    tree["qos_overrides"] = {"/parameter_events": {"publisher": {"depth": 1000}}}
    file = tmp_path / "dump.yaml"
    file.write_text(yaml.safe_dump({f"/{DRUM}/motor": {"ros__parameters": tree}}))
    assert machine_parameters(DRUM, file) == machine_parameters(DRUM, configuration_file(DRUM))
    rclpy.init(args=["n", "--ros-args", "--params-file", str(file)], signal_handler_options=SignalHandlerOptions.NO)
    try:
        with machine_of("motor") as (machine, page):
            node = MotorNode(machine, page)
        assert node.machine.parameters == machine_parameters(DRUM)
        node.destroy_node()
    finally:
        rclpy.try_shutdown()


def page_node(*words: str) -> tuple[str, Parameters]:
    """Return namespace and configuration of a node of a page that is started with these ROS arguments."""
    rclpy.init(args=["n", "--ros-args", *words], signal_handler_options=SignalHandlerOptions.NO)
    try:
        with machine_of("motor") as (machine, page):
            node = TwinNode("motor", machine, page)
        found = node.get_namespace(), node.initial_parameters
        assert node.get_parameter("machine").value == "page"  # and so a dump of its parameters is a whole page
        node.destroy_node()
        return found
    finally:
        rclpy.try_shutdown()


@pytest.mark.parametrize("page", PAGES)
def test_the_path_of_a_page_makes_a_node_of_its_name(page: str) -> None:
    parameters = machine_parameters(page)
    assert page_node("-p", f"machine:={page}") == (f"/{parameters.name}", parameters)


def test_keys_and_a_namespace_are_laid_over_a_page(tmp_path: Path) -> None:
    page = next(page for page in PAGES if page.endswith("spring_hammer.yaml"))
    softer = machine_parameters(page, None, {"springs.spring.rate_n_per_m": 7000.0})
    told = ["-p", f"machine:={page}", "-p", "springs.spring.rate_n_per_m:=7000.0"]
    assert page_node(*told) == ("/spring_hammer", softer)
    assert page_node(*told, "-r", "__ns:=/hall/left") == ("/hall/left", softer)
    whole = tmp_path / "whole.yaml"
    whole.write_text(_parameter_file("page", softer, RunOptions()), encoding="utf-8")
    assert page_node("--params-file", str(whole)) == ("/spring_hammer", softer)


def test_the_programs_of_a_page_run_it_by_its_path(tmp_path: Path) -> None:
    page = tmp_path / "mine.yaml"
    page.write_text(mech_twin("new", "slider_crank").out, encoding="utf-8")
    bag, running = tmp_path / "bag", []
    options = {"machine": page.name, "run.duration_s": 0.1, "run.recorder": "true", "run.exclusive": "false"}
    ros = ["--ros-args", *(word for name, value in options.items() for word in ("-p", f"{name}:={value}"))]
    for node, *own in (("recorder", "--directory", str(bag)), ("motor",), ("force",), ("linkage",)):
        code = f"from mech_twin.nodes.run.executables import {node}_node; {node}_node()"
        running.append(subprocess.Popen([sys.executable, "-c", code, *own, *ros], cwd=tmp_path))
    try:
        assert running[-1].wait(60) == 0
    finally:
        for each in running:
            each.terminate()
    assert [each.wait(30) for each in running] == [0, 0, 0, 0]
    judged = json.loads(mech_twin("replay", str(bag), "--resimulate", "--json").out)
    assert (judged["identical"], judged["steps_compared"]) == (True, 101)
    assert "/slider_crank/step/linkage" in mech_twin("info", str(bag), "--json").out


def started_with(file: Path, machine_name: str) -> Parameters:
    """Return the configuration of a motor node that is started with a parameter file."""
    rclpy.init(args=["n", "--ros-args", "--params-file", str(file)], signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = MotorNode(machine_name)
        node.destroy_node()
        return node.initial_parameters
    finally:
        rclpy.try_shutdown()


def without_added_mass(tmp_path: Path) -> Path:
    """Return a whole configuration that leaves out a key that the installed one has: the sum of the parts counts."""
    lines = configuration_file("vibration_crank").read_text(encoding="utf-8").splitlines()
    file = tmp_path / "own.yaml"
    file.write_text("\n".join(line for line in lines if "rotating_kg" not in line), encoding="utf-8")
    return file


def test_a_whole_configuration_counts_alone(tmp_path: Path) -> None:
    own, of_own_motor = without_added_mass(tmp_path), configuration_file("roller_former_4")
    for name, file in (("vibration_crank", own), ("roller_former", of_own_motor)):
        expected = machine_parameters(name, file)
        assert started_with(file, name) == expected != machine_parameters(name)
        handed = tmp_path / f"{name}.yaml"
        handed.write_text(_parameter_file(name, expected, RunOptions()), encoding="utf-8")
        assert started_with(handed, name) == expected


def test_single_keys_are_laid_over_the_installed_configuration(tmp_path: Path) -> None:
    file = section(tmp_path, **{"__**": {"machine": "vibration_crank", "crank_m": 0.1}})
    assert started_with(file, "vibration_crank") == machine_parameters("vibration_crank", None, {"crank_m": 0.1})
