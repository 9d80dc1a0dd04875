# SPDX-License-Identifier: Apache-2.0
"""Which machine a node is of is a parameter: resolved by rcl for the node's name, read-only, without default."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import rclpy
import yaml
from bench_run import BenchRun
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters
from rclpy.signals import SignalHandlerOptions

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.nodes.roles.answering_nodes import MotorNode
from mech_twin.nodes.run.executables import machine_of
from mech_twin.parameters.load import configuration_file, machine_parameters

pytestmark = pytest.mark.usefixtures("ros_domain")
DRUM = "winding_drum"


def section(tmp_path: Path, **sections: dict[str, str]) -> Path:
    path = tmp_path / "parameters.yaml"
    document = {name.replace("__", "/"): {"ros__parameters": tree} for name, tree in sections.items()}
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
        with machine_of("motor") as machine:
            assert machine == expected
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
        with machine_of("motor") as machine:
            node = MotorNode(machine)
        assert node.machine.parameters == machine_parameters(DRUM)
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
