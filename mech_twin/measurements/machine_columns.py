# SPDX-License-Identifier: Apache-2.0
"""Measurable quantities of a machine: columns of a run and events, with their SI units."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from mech_twin.capabilities.blow_gauge import GAUGE_UNITS
from mech_twin.declarations.captions import unit_of as caption_unit
from mech_twin.engine.coupling import complete_frame
from mech_twin.engine.trajectory import frame_numbers
from mech_twin.measurements.units import UNITS, shown_unit
from mech_twin.roles import Machine

SLIDING = (
    "slider",
    "mass",
    "yarn",
    "package_radius",
    "cart_",
)  # prefixes of names of sliding joints; others turn
_SLIDING_UNITS = {"position": "m", "velocity": "m/s", "effort": "N"}
_TURNING_UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}
_ENDINGS = {
    "_rad_per_s2": "rad/s2", "_m_per_s2": "m/s2", "_rad_per_s": "rad/s", "_m_per_s": "m/s", "_rad": "rad", "_nm": "N.m",
    "_nms": "N.m.s", "_ns": "N.s", "_n": "N", "_m": "m", "_w": "W", "_kg_m2": "kg.m2",
    "_kg": "kg", "_j": "J", "_s": "s",
}  # fmt: skip
EVENT = "event"
EVENT_UNITS = {"time": "s", "pre_velocity": "m/s", "post_velocity": "m/s", "impulse": "N.s", **GAUGE_UNITS}


class JointColumn(NamedTuple):
    """The parts of a column of a joint: ``linkage.crank.position``."""

    role: str
    joint: str
    field: str


def slides(joint: str) -> bool:
    """Return whether a joint slides, by its name."""
    return joint.startswith(SLIDING)


def sliding_in(machine: Machine) -> frozenset[str]:
    """Return the sliding joints of a machine, by their names and by its mechanism."""
    named = frozenset(filter(slides, machine.linkage.joints))
    return named if machine.mechanism is None else named | machine.mechanism.sliding_joints


def joint_column(column: str) -> JointColumn | None:
    """Return the parts of a joint's column; None for other columns."""
    role, _, rest = column.partition(".")
    joint, _, field = rest.partition(".")
    return JointColumn(role, joint, field) if role != EVENT and field in _TURNING_UNITS else None


def unit_of(column: str) -> str:
    """Return the SI unit of a column; ``1`` if its name contains none."""
    parts = joint_column(column)
    if parts is not None:
        return (_SLIDING_UNITS if slides(parts.joint) else _TURNING_UNITS)[parts.field]
    if column.startswith(f"{EVENT}."):
        return EVENT_UNITS[column.rpartition(".")[2]]
    return next((unit for ending, unit in _ENDINGS.items() if column.endswith(ending)), "1")


def machine_columns(machine: Machine) -> Mapping[str, str]:
    """Return every column of a run of the machine, and its SI unit."""
    frame = complete_frame(machine, machine.linkage.start(), None, 1.0)
    names = [name for name, _ in frame_numbers(frame) if name != "time_s"]
    sliding = sliding_in(machine)
    return {name: unit_in(name, sliding) for name in names}


def shown_units(machine: Machine) -> Mapping[str, str]:
    """Return the display unit of every column of a run of the machine, empty for a dimensionless one."""
    return {name: caption_unit(name) or shown_unit(unit) for name, unit in machine_columns(machine).items()}


def unit_in(column: str, sliding: frozenset[str]) -> str:
    """Return the SI unit of a column of a machine with these sliding joints."""
    parts = joint_column(column)
    return _SLIDING_UNITS[parts.field] if parts is not None and parts.joint in sliding else unit_of(column)


def is_event(column: str) -> bool:
    """Return whether the name is that of an event channel, such as ``event.blow.time``."""
    parts = column.split(".")
    return len(parts) == 3 and parts[0] == EVENT and bool(parts[1]) and parts[2] in EVENT_UNITS


def is_angle(column: str) -> bool:
    """Return whether a column is an angle, which a sensor may give modulo one turn."""
    return unit_of(column) == UNITS["rad"].si
