# SPDX-License-Identifier: Apache-2.0
"""A recording names the ROS 2 release it was made with, not the one the project is pinned to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest
import yaml

from mech_twin.recording.bag_metadata import running_distro
from mech_twin.recording.bag_writer import BagWriter

ROOT = Path(__file__).resolve().parents[2]


def having(versions: Mapping[str, str]) -> Callable[[str], str]:
    def installed(name: str) -> str:
        if name not in versions:
            raise PackageNotFoundError(name)
        return versions[name]

    return installed


@pytest.mark.parametrize(
    ("environment", "versions", "expected"),
    [
        ({"ROS_DISTRO": "rolling"}, {"ros-rclpy": "7.1.6"}, "rolling"),
        ({}, {"ros-rclpy": "7.1.6", "rclpy": "7.1.5"}, "jazzy"),
        ({}, {"ros-rclpy": "9.1.2"}, "kilted"),
        ({"ROS_DISTRO": ""}, {"rclpy": "7.1.5"}, "jazzy"),
        ({}, {"rclpy": "77.0.0"}, "unknown"),
        ({}, {}, "unknown"),
    ],
)
def test_the_release_is_the_one_that_runs(
    environment: Mapping[str, str], versions: Mapping[str, str], expected: str
) -> None:
    assert running_distro(environment, having(versions)) == expected


@pytest.mark.parametrize("line", ["jazzy", "kilted"])
def test_the_pinned_rclpy_of_each_line_is_known_by_its_name(line: str) -> None:
    pins = (ROOT / "constraints" / f"{line}.txt").read_text(encoding="utf-8").splitlines()
    version = next(pin.partition("==")[2] for pin in pins if pin.startswith("ros-rclpy=="))
    assert running_distro({}, having({"ros-rclpy": version})) == line


def test_a_recording_names_the_release(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DISTRO", "rolling")
    with BagWriter(tmp_path / "bag", configuration="") as writer:
        writer.add_topic("/heard", "std_msgs/msg/String")
    content = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text(encoding="utf-8"))
    assert content["rosbag2_bagfile_information"]["ros_distro"] == "rolling"
