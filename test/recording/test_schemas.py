# SPDX-License-Identifier: Apache-2.0
"""Definitions come from the installed packages, with nothing of ROS in the environment."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
import yaml
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mech_twin.recording.errors import UnknownTypeError
from mech_twin.recording.schemas import message_schema, offered_qos

STANDARD = [
    "sensor_msgs/msg/JointState",
    "geometry_msgs/msg/WrenchStamped",
    "geometry_msgs/msg/Vector3Stamped",
    "visualization_msgs/msg/MarkerArray",
    "std_msgs/msg/String",
    "std_msgs/msg/Float64",
    "rosgraph_msgs/msg/Clock",
    "diagnostic_msgs/msg/DiagnosticArray",
    "rcl_interfaces/msg/ParameterEvent",
]


@pytest.mark.parametrize("type_name", STANDARD)
def test_definition_is_complete(type_name: str) -> None:
    schema = message_schema(type_name)
    types = get_types_from_msg(schema.definition, type_name)
    assert type_name in types
    text = Schema(id=1, data=schema.definition.encode(), encoding="ros2msg", name=type_name)
    assert DecoderFactory().decoder_for("cdr", text) is not None


@pytest.mark.parametrize("type_name", STANDARD)
def test_hash_is_that_of_the_definition(type_name: str) -> None:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(message_schema(type_name).definition, type_name))
    assert store.hash_rihs01(type_name) == message_schema(type_name).type_hash


@pytest.mark.parametrize(
    ("type_name", "complaint"),
    [
        ("sensor_msgs/msg/Nothing", "no sensor_msgs/msg/Nothing.json under"),
        ("nowhere_msgs/msg/Thing", "no nowhere_msgs/msg/Thing.json under"),
        ("sensor_msgs/JointState", "expected package/msg/Type"),
        ("../../etc/msg/Passwd", "expected package/msg/Type"),
        ("", "expected package/msg/Type"),
    ],
)
def test_unknown_type_is_refused_by_name(type_name: str, complaint: str) -> None:
    with pytest.raises(UnknownTypeError, match=complaint):
        message_schema(type_name)


def test_no_environment_is_needed() -> None:
    code = "from mech_twin.recording.schemas import message_schema as s; print(s('std_msgs/msg/String').type_hash)"
    bare = {key: value for key, value in os.environ.items() if not key.startswith(("AMENT", "ROS", "_ROS", "LD_"))}
    done = subprocess.run([sys.executable, "-c", code], env=bare, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("RIHS01_")


def test_offered_qos_is_a_list_of_one_profile() -> None:
    (profile,) = yaml.safe_load(offered_qos(durability="transient_local", depth=3))
    assert (profile["durability"], profile["depth"], profile["reliability"]) == ("transient_local", 3, "reliable")
    assert profile["deadline"] == {"sec": 9223372036, "nsec": 854775807}
