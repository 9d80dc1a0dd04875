"""ForceSample <-> sensor_msgs/JointState on ``forces/joint_states``, and each pin reaction as a wrench.

Every row is an effort.  A pin has three rows, ``PIN/force_x_n``, ``PIN/force_y_n`` and ``PIN/moment_nm``.
"""

from __future__ import annotations

import math
from array import array
from functools import lru_cache
from typing import NamedTuple

from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState

from mech_twin.messages.step_message import MARK, RESIDUAL, STEP, AnyStep, MessageError, set_stamp, step_and_time, table
from mech_twin.samples import ForceSample, Load, Named, Wrench

BODY_MOMENT = "~body_moment_nm"
LOAD = "~load/"
COMPONENTS = ("force_x_n", "force_y_n", "moment_nm")
LOAD_COLUMNS = ("time_s", "moment_before_nm", "moment_after_nm", "impulse_nms")


@lru_cache(maxsize=64)
def _row_names(pins: tuple[str, ...], quantities: tuple[str, ...], residuals: tuple[str, ...]) -> tuple[str, ...]:
    components = (f"{pin}/{component}" for pin in pins for component in COMPONENTS)
    return (*components, *quantities, STEP, BODY_MOMENT, *(RESIDUAL + name for name in residuals))


def to_message(sample: ForceSample, message: JointState | None = None) -> JointState:
    """Return the sample as a message."""
    message = message or JointState()
    set_stamp(message.header, sample.time_s)
    names = list(_row_names(sample.pins, sample.quantities.names, sample.residuals.names))
    effort = [value for wrench in sample.wrenches for value in wrench]
    effort += (*sample.quantities.values, 0.0, sample.body_moment_nm, *sample.residuals.values)
    for i, load in enumerate(sample.loads):
        names += [f"{LOAD}{i}/{load.kind}/{load.contact}/{column}" for column in LOAD_COLUMNS]
        effort += (load.time_s, load.moment_before_nm, load.moment_after_nm, load.impulse_nms)
    message.name = names
    message.effort = array("d", effort)
    position = array("d", bytes(8 * len(effort)))
    velocity = array("d", position)
    step_row = names.index(STEP)
    position[step_row], velocity[step_row] = float(sample.step), sample.time_s
    message.position, message.velocity = position, velocity
    return message


class ForceLayout(NamedTuple):
    """Where everything stands in a force message with these row names."""

    pins: tuple[str, ...]
    quantities: tuple[str, ...]
    quantity_rows: tuple[int, ...]
    loads: tuple[tuple[str, str, int], ...]


@lru_cache(maxsize=1024)
def _layout(names: tuple[str, ...]) -> ForceLayout:
    plain = [name for name in names if not name.startswith(MARK)]
    pins = tuple(name.removesuffix("/force_x_n") for name in plain if name.endswith("/force_x_n"))
    of_pins = {f"{pin}/{component}" for pin in pins for component in COMPONENTS}
    if not of_pins <= set(plain):
        raise MessageError("a pin has not all three components")
    quantities = tuple(name for name in plain if name not in of_pins)
    loads = tuple(_load(names, row) for row, name in enumerate(names) if name.startswith(LOAD) and _is_head(name))
    return ForceLayout(pins, quantities, tuple(names.index(name) for name in quantities), loads)


def _is_head(name: str) -> bool:
    return name.endswith(f"/{LOAD_COLUMNS[0]}")


def _load(names: tuple[str, ...], row: int) -> tuple[str, str, int]:
    """Return kind, contact and first row of a load, whose rows stand together."""
    parts = names[row].split("/")
    expected = tuple("/".join((*parts[:-1], column)) for column in LOAD_COLUMNS)
    if len(parts) != 5 or names[row : row + len(expected)] != expected:
        raise MessageError(f"load '{names[row]}' has not all its rows")
    return parts[2], parts[3], row


def from_message(message: AnyStep, step_s: float | None = None) -> ForceSample:
    """Return the sample of a message.

    Raises
    ------
    MessageError
        If the message is no force sample.
    """
    content = table(message)
    step, time_s = step_and_time(message, content, step_s)
    names = tuple(message.name)
    where = _layout(names)
    effort = content.effort
    first = {name: i for i, name in enumerate(names)}
    moment = content.layout.scalars.get(BODY_MOMENT)
    if moment is None:
        raise MessageError(f"row '{BODY_MOMENT}' is missing")
    return ForceSample(
        step,
        time_s,
        where.pins,
        tuple([Wrench(*(effort[first[f"{pin}/{component}"]] for component in COMPONENTS)) for pin in where.pins]),
        Named(where.quantities, tuple([effort[i] for i in where.quantity_rows])),
        effort[moment],
        Named(content.layout.residuals, tuple([effort[i] for i in content.layout.residual_rows])),
        tuple([Load(effort[i], kind, contact, *effort[i + 1 : i + 4]) for kind, contact, i in where.loads]),
    )


def wrench_message(time_s: float, frame: str, wrench: Wrench, message: WrenchStamped | None = None) -> WrenchStamped:
    """Return one pin reaction as a stamped wrench; ``frame`` is the pin's frame."""
    stamped = message or WrenchStamped()
    set_stamp(stamped.header, time_s)
    stamped.header.frame_id = frame
    stamped.wrench.force.x = wrench.force_x_n
    stamped.wrench.force.y = wrench.force_y_n
    stamped.wrench.torque.z = wrench.moment_nm
    return stamped


def wrench_size(wrench: Wrench) -> float:
    """Return the magnitude by which wrenches are compared when a stream is decimated."""
    return math.hypot(wrench.force_x_n, wrench.force_y_n) + abs(wrench.moment_nm)
