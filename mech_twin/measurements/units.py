# SPDX-License-Identifier: Apache-2.0
"""Units of measured channels, and the measurable quantities of a machine: columns of a run and events."""

import re
from collections.abc import Mapping
from math import pi
from types import MappingProxyType
from typing import NamedTuple

from mech_twin.capabilities.blow_gauge import GAUGE_UNITS
from mech_twin.declarations.captions import unit_of as caption_unit
from mech_twin.engine.coupling import complete_frame
from mech_twin.engine.trajectory import frame_numbers
from mech_twin.roles import Machine

SLIDING = ("slider", "mass", "yarn", "package_radius", "cart_")  # prefixes of names of sliding joints; others turn
_SLIDING_UNITS = {"position": "m", "velocity": "m/s", "effort": "N"}
_TURNING_UNITS = {"position": "rad", "velocity": "rad/s", "effort": "N.m"}
POWERS = str.maketrans("²³", "23")
EVENT = "event"
EVENT_UNITS = {"time": "s", "pre_velocity": "m/s", "post_velocity": "m/s", "impulse": "N.s", **GAUGE_UNITS}


class Unit(NamedTuple):
    """A unit: the SI unit of its quantity, and the factor to it."""

    si: str
    factor: float


TURN = 2.0 * pi
# size of each unit in the SI unit of its quantity
_SIZES: Mapping[str, Mapping[str, float]] = {
    "rad": {"deg": pi / 180.0, "mrad": 1e-3, "turn": TURN},
    "rad/s": {"deg/s": pi / 180.0, "rpm": TURN / 60.0, "turn/s": TURN},
    "rad/s2": {},
    "m": {"cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "m/s": {"mm/s": 1e-3, "m/min": 1.0 / 60.0},
    "m/s2": {},
    "N": {"kN": 1e3},
    "N.m": {"N.mm": 1e-3, "kN.m": 1e3},
    "N.s": {},
    "W": {"kW": 1e3},
    "J": {},
    "s": {},
    "A": {},
    "count": {},
    "1": {"um/m": 1e-6},
}
UNITS: Mapping[str, Unit] = MappingProxyType(
    {name: Unit(si, size) for si, sizes in _SIZES.items() for name, size in {si: 1.0, **sizes}.items()}
)
TIME_UNITS: Mapping[str, float] = MappingProxyType(
    {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
)
SCALED_BY_GAIN = ("A", "count")  # units of raw signals, which a gain scales to any quantity

# spellings of units in table headers, in lower case without blanks and brackets
_SPELLINGS: Mapping[str, str] = MappingProxyType(
    {
        **{name.lower(): name for name in UNITS if name != "1"},
        "degree": "deg", "degrees": "deg", "°": "deg", "°/s": "deg/s", "degree/s": "deg/s", "degrees/s": "deg/s",
        "rads": "rad", "radian": "rad", "radians": "rad", "radians/s": "rad/s", "rad_per_s": "rad/s", "1/s": "rad/s",
        "deg_per_s": "deg/s", "rev": "turn", "turns": "turn", "revolutions": "turn", "1/min": "rpm", "u/min": "rpm",
        "r/min": "rpm", "rev/min": "rpm", "min-1": "rpm", "millimeter": "mm", "millimetre": "mm", "meter": "m",
        "metre": "m", "m_per_s": "m/s", "mm_per_s": "mm/s", "nm": "N.m", "n*m": "N.m", "n·m": "N.m", "n_m": "N.m",
        "nmm": "N.mm", "n·mm": "N.mm", "knm": "kN.m", "kn·m": "kN.m", "hz": "turn/s", "rev/s": "turn/s",
        "newton": "N", "µm": "um", "amp": "A", "amps": "A", "ampere": "A", "counts": "count", "ticks": "count",
        "m/s^2": "m/s2", "m/s²": "m/s2", "sec": "s", "second": "s", "seconds": "s", "w": "W",
        "rad/sec": "rad/s", "deg/sec": "deg/s", "m/sec": "m/s", "mm/sec": "mm/s",
    }
)  # fmt: skip
_TIME_SPELLINGS = {
    **{name: name for name in TIME_UNITS},
    "sec": "s", "seconds": "s", "second": "s", "msec": "ms", "milliseconds": "ms", "µs": "us", "usec": "us",
    "microseconds": "us", "nanoseconds": "ns", **dict.fromkeys(("minute", "minutes", "mins"), "min"),
    **dict.fromkeys(("hour", "hours", "hr", "hrs"), "h"),
}  # fmt: skip


BRACKETED = r"[(\[{<]\s*([^)\]}>]+?)\s*[)\]}>]"  # what stands in brackets of a header


def shown_unit(si: str) -> str:
    """Return the display form of a unit: N m for ``N.m``, empty for ``1``."""
    return "" if si == "1" else si.replace(".", " ").replace("2", "²")


def unit_in(text: str) -> str | None:
    """Return the unit in a header such as ``Slide position (mm)`` or ``slide_mm``; None without one."""
    return _found_in(text, _SPELLINGS)


def time_unit_in(text: str) -> str | None:
    """Return the unit of time in a header; None without one."""
    return _found_in(text, _TIME_SPELLINGS)


def unread_unit(text: str) -> str | None:
    """Return the text in the last brackets of a header if it is no known unit."""
    words = re.findall(BRACKETED, text)
    return words[-1] if words and unit_in(text) is None else None


def is_unit(text: str) -> bool:
    """Return whether a cell is a unit alone, such as ``mm`` or ``[deg]``."""
    word = "".join(text.lower().split()).strip("()[]")
    return word in _SPELLINGS or word in _TIME_SPELLINGS


def _found_in(text: str, spellings: Mapping[str, str]) -> str | None:
    words = text.strip().lower()
    bracketed = re.findall(BRACKETED, words)
    endings = [words.split("_", i)[-1] for i in range(words.count("_"), 0, -1)][::-1]
    for word in (*bracketed[::-1], *endings, words.rpartition(",")[2], words.rpartition(" ")[2]):
        unit = spellings.get("".join(word.split()))
        if unit is not None:
            return unit
    return None


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


def leading_in(machine: Machine) -> str:
    """Return the joint that the drive leads, by the mechanism; else the first of the linkage."""
    leading = "" if machine.mechanism is None else machine.mechanism.leading
    return leading or machine.linkage.joints[0]


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
    return caption_unit(column).replace(" ", ".").translate(POWERS) or "1"


def machine_columns(machine: Machine) -> Mapping[str, str]:
    """Return every column of a run of the machine, and its SI unit."""
    frame = complete_frame(machine, machine.linkage.start(), None, 1.0)
    names = [name for name, _ in frame_numbers(frame) if name != "time_s"]
    sliding = sliding_in(machine)
    return {name: column_unit(name, sliding) for name in names}


def shown_units(machine: Machine) -> Mapping[str, str]:
    """Return the display unit of every column of a run of the machine, empty for a dimensionless one."""
    return {name: caption_unit(name) or shown_unit(unit) for name, unit in machine_columns(machine).items()}


def column_unit(column: str, sliding: frozenset[str]) -> str:
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
