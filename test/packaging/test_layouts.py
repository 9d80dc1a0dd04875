# SPDX-License-Identifier: Apache-2.0
"""What RViz and Foxglove are told to show exists: topics with their types, frames, joints, panels."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from catalogue import NAMES, built
from ci_scripts import ci_script

from mech_twin.messages.scene import frame_id
from mech_twin.messages.topics import FRAMES, ROBOT_DESCRIPTION, Topic, full_name, recorded_topics

ROOT = Path(__file__).resolve().parents[2]
RVIZ_TYPES = {"RobotModel": "String", "MarkerArray": "MarkerArray", "Wrench": "WrenchStamped"}


LAYOUTS = ci_script("layouts")


def topics_of(name: str) -> dict[str, Topic]:
    machine = built(name)
    listed = (*recorded_topics(machine.forces.pins, machine.body is not None), FRAMES, ROBOT_DESCRIPTION)
    return {full_name(name, topic): topic for topic in listed}


def frames_of(name: str) -> set[str]:
    mechanism = built(name).mechanism
    assert mechanism is not None
    return {frame_id(name, frame) for frame in mechanism.frames}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("pattern", LAYOUTS.FILES)
def test_layouts_are_those_that_are_made(pattern: str, name: str) -> None:
    path = ROOT / pattern.format(name)
    assert path.read_text(encoding="utf-8") == LAYOUTS.FILES[pattern](name), "run python .ci/layouts.py"


@pytest.mark.parametrize("name", NAMES)
def test_rviz_shows_topics_of_the_right_type_in_a_frame_that_exists(name: str) -> None:
    content = yaml.safe_load((ROOT / "rviz" / f"{name}.rviz").read_text(encoding="utf-8"))["Visualization Manager"]
    assert content["Global Options"]["Fixed Frame"] in frames_of(name)
    shown = 0
    for display in content["Displays"]:
        kind = display["Class"].rpartition("/")[2]
        topic = display.get("Topic") or display.get("Description Topic")
        if topic is not None:
            assert topics_of(name)[topic["Value"]].type.__name__ == RVIZ_TYPES[kind]
            assert (topic["Durability Policy"] == "Transient Local") == (kind == "RobotModel")
            shown += 1
        if kind == "RobotModel":
            assert f"{display['TF Prefix']}/machine" in frames_of(name)
    assert shown == 2 + len(built(name).forces.pins)


def panels_in(layout: Any) -> Iterator[str]:
    if isinstance(layout, str):
        yield layout
    else:
        yield from panels_in(layout["first"])
        yield from panels_in(layout["second"])


def field(message: Any, path: str) -> Any:
    """Return what a message path leads to in a blank message; an index leads into a column of numbers."""
    for word in filter(None, re.split(r"\.|\[\d+\]", path)):
        message = getattr(message, word)
    return message


@pytest.mark.parametrize("name", NAMES)
def test_foxglove_shows_fields_that_exist(name: str) -> None:
    content = json.loads((ROOT / "foxglove" / f"{name}.json").read_text(encoding="utf-8"))
    assert sorted(panels_in(content["layout"])) == sorted(content["configById"])
    topics, shown = topics_of(name), 0
    for panel, config in content["configById"].items():
        for curve in config.get("paths", []):
            topic, _, path = curve["value"].partition(".")
            found = field(topics[topic].type(), path)
            assert isinstance(found, float) or found.typecode == "d"
            for index in re.findall(r"\[(\d+)\]", path):
                assert built(name).linkage.joints[int(index)] == curve["label"]
            shown += 1
        if panel.startswith("3D!"):
            assert set(config["topics"]) <= set(topics)
            assert config["followTf"] in frames_of(name)
            assert topics[config["layers"]["urdf"]["topic"]] == ROBOT_DESCRIPTION
            assert config["layers"]["urdf"]["framePrefix"] + "machine" in frames_of(name)
        if panel.startswith("Diagnostic"):
            assert config["topicToRender"] in topics
    assert shown > 3
