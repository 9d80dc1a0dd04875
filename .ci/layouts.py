# SPDX-License-Identifier: Apache-2.0
"""Writes an RViz configuration and a Foxglove layout of each machine: ``python .ci/layouts.py``."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import yaml

from mech_twin.capabilities.mechanism import ROOT as ROOT_FRAME
from mech_twin.capabilities.mechanism import poses
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.messages.scene import frame_id
from mech_twin.messages.topics import (
    DIAGNOSTICS,
    IMPACTS,
    JOINT_STATES,
    LATCHED,
    ROBOT_DESCRIPTION,
    SCENE,
    Topic,
    full_name,
    pin_wrench,
)
from mech_twin.parameters.load import machine_parameters
from mech_twin.roles import Machine

PLACE = Path(__file__).resolve().parents[1]
SHOWN_PINS = 6
PIXELS = 500.0  # across the machine


def machine_named(name: str) -> Machine:
    """Return a machine of the installed configuration."""
    return CATALOGUE[name].build(machine_parameters(name))


def size_m(machine: Machine) -> float:
    """Return how far the farthest frame lies from the root at the start."""
    assert machine.mechanism is not None
    start = machine.linkage.start()
    at = poses(machine.mechanism, dict(zip(start.joints, start.position, strict=True)))
    return max(0.1, *(math.hypot(pose.x_m, pose.y_m) for pose in at.values()))


# -- RViz -------------------------------------------------------------------------------------------------------------


def rviz(name: str) -> str:
    """Return the RViz configuration of a machine: description, frames, drawing, wrenches, seen from above."""
    machine = machine_named(name)
    displays = [
        _display("Grid", "Grid", {"Plane": "XY", "Cell Size": 0.1, "Plane Cell Count": 40, "Alpha": 0.3}),
        _display(
            "RobotModel",
            name,
            {
                "Description Source": "Topic",
                "Description Topic": _topic(name, ROBOT_DESCRIPTION),
                "TF Prefix": frame_id(name, "").rstrip("/"),
                "Visual Enabled": True,
            },
        ),
        _display("TF", "frames", {"Marker Scale": round(0.3 * size_m(machine), 3), "Show Names": False}),
        _display("MarkerArray", "drawing", {"Topic": _topic(name, SCENE)}),
        *(
            _display("Wrench", pin, {"Topic": _topic(name, pin_wrench(pin)), "Torque Arrow Scale": 0.0})
            for pin in machine.forces.pins
        ),
    ]
    content = {
        "Panels": [
            {"Class": "rviz_common/Displays", "Name": "Displays"},
            {"Class": "rviz_common/Time", "Name": "Time"},
        ],
        "Visualization Manager": {
            "Class": "",
            "Displays": displays,
            "Enabled": True,
            "Global Options": {"Fixed Frame": frame_id(name, ROOT_FRAME), "Frame Rate": 30},
            "Name": "root",
            "Tools": [{"Class": "rviz_default_plugins/MoveCamera"}, {"Class": "rviz_default_plugins/Select"}],
            "Value": True,
            "Views": {
                "Current": {
                    "Class": "rviz_default_plugins/TopDownOrtho",
                    "Name": "Current View",
                    "Scale": round(PIXELS / (2.0 * size_m(machine)), 1),
                    "Target Frame": "<Fixed Frame>",
                }
            },
        },
    }
    return yaml.safe_dump(content, sort_keys=False, width=120)


def _display(kind: str, name: str, content: dict[str, Any]) -> dict[str, Any]:
    return {"Class": f"rviz_default_plugins/{kind}", "Name": name, "Enabled": True, "Value": True, **content}


def _topic(machine_name: str, topic: Topic) -> dict[str, Any]:
    durability = "Transient Local" if topic.qos is LATCHED else "Volatile"
    return {
        "Value": full_name(machine_name, topic),
        "Depth": 5,
        "Durability Policy": durability,
        "History Policy": "Keep Last",
        "Reliability Policy": "Reliable",
    }


# -- Foxglove ---------------------------------------------------------------------------------------------------------


def foxglove(name: str) -> str:
    """Return the Foxglove layout of a machine: the mechanism, speeds and efforts, pin forces, impacts, diagnostics."""
    machine = machine_named(name)
    joints = full_name(name, JOINT_STATES)
    columns = {
        "speeds": [(f"{joints}.velocity[{i}]", joint) for i, joint in enumerate(machine.linkage.joints)],
        "efforts": [(f"{joints}.effort[{i}]", joint) for i, joint in enumerate(machine.linkage.joints)],
        "pins": [
            (f"{full_name(name, pin_wrench(pin))}.wrench.force.{axis}", f"{pin} {axis}")
            for pin in machine.forces.pins[:SHOWN_PINS]
            for axis in "xy"
        ],
        "impacts": [(f"{full_name(name, IMPACTS)}.vector.z", "impulse")],
    }
    panels: dict[str, Any] = {f"Plot!{title}": _plot(title, curves) for title, curves in columns.items()}
    panels["3D!machine"] = _space(name, machine)
    panels["DiagnosticSummary!state"] = {"topicToRender": DIAGNOSTICS.name, "minLevel": 0, "pinnedIds": []}
    content = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _row(
            _column("3D!machine", "DiagnosticSummary!state", 75),
            _column(_column("Plot!speeds", "Plot!efforts", 50), _column("Plot!pins", "Plot!impacts", 50), 50),
            50,
        ),
    }
    return json.dumps(content, indent=1) + "\n"


def _plot(title: str, curves: list[tuple[str, str]]) -> dict[str, Any]:
    paths = [
        {"value": path, "label": label, "enabled": True, "timestampMethod": "headerStamp"} for path, label in curves
    ]
    return {"title": title, "paths": paths, "showLegend": True, "xAxisVal": "timestamp", "showXAxisLabels": True}


def _space(name: str, machine: Machine) -> dict[str, Any]:
    urdf = {
        "instanceId": "urdf",
        "layerId": "foxglove.Urdf",
        "label": name,
        "sourceType": "topic",
        "topic": full_name(name, ROBOT_DESCRIPTION),
        "framePrefix": frame_id(name, ""),
        "visible": False,
    }
    return {
        "layers": {"urdf": urdf},
        "followTf": frame_id(name, ROOT_FRAME),
        "followMode": "follow-pose",
        "topics": {full_name(name, SCENE): {"visible": True}},
        "cameraState": {
            "perspective": False,
            "distance": round(3.0 * size_m(machine), 3),
            "phi": 0.0,
            "thetaOffset": 0.0,
        },
    }


def _row(first: Any, second: Any, percentage: int) -> dict[str, Any]:
    return {"direction": "row", "first": first, "second": second, "splitPercentage": percentage}


def _column(first: Any, second: Any, percentage: int) -> dict[str, Any]:
    return _row(first, second, percentage) | {"direction": "column"}


FILES = {"rviz/{}.rviz": rviz, "foxglove/{}.json": foxglove}


def main() -> None:
    """Write them all."""
    for pattern, text in FILES.items():
        for name in CATALOGUE:
            path = PLACE / pattern.format(name)
            path.parent.mkdir(exist_ok=True)
            path.write_text(text(name), encoding="utf-8")


if __name__ == "__main__":
    main()
