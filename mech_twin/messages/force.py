# SPDX-License-Identifier: Apache-2.0
"""ForceSample <-> sensor_msgs/JointState on ``step/forces``, and each pin reaction as a wrench.

Every row is an effort.  A pin has three rows, ``PIN/force_x_n``, ``PIN/force_y_n`` and ``PIN/moment_nm``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import chain
from typing import NamedTuple

from geometry_msgs.msg import WrenchStamped
from sensor_msgs.msg import JointState

from mech_twin.messages.identity import Names, of_the_same
from mech_twin.messages.joint_state_cdr import AnyStep, Header, StepMessage, encoded, joint_state, stamp_of
from mech_twin.messages.stamped_cdr import stamped_bytes
from mech_twin.messages.step_bytes import NUMBER, RowForm, mark_names, row_form, written
from mech_twin.messages.step_message import MARK, RESIDUAL, STEP, MessageError, Row, set_stamp
from mech_twin.messages.step_table import step_and_time, table
from mech_twin.samples import ForceSample, Load, Named, Wrench

BODY_MOMENT = "~body_moment_nm"
LOAD = "~load/"
COMPONENTS = ("force_x_n", "force_y_n", "moment_nm")
LOAD_COLUMNS = ("time_s", "moment_before_nm", "moment_after_nm", "impulse_nms")


@lru_cache(maxsize=64)
def effort_names(pins: tuple[str, ...], quantities: tuple[str, ...]) -> tuple[str, ...]:
    """Return the names of the efforts: three components a pin, then the derived quantities."""
    return (*(f"{pin}/{component}" for pin in pins for component in COMPONENTS), *quantities)


@lru_cache(maxsize=1024)
def _row_names(
    pins: tuple[str, ...], quantities: tuple[str, ...], residuals: tuple[str, ...], more: tuple[str, ...]
) -> tuple[str, ...]:
    return (*effort_names(pins, quantities), STEP, BODY_MOMENT, *(RESIDUAL + name for name in residuals), *more)


def efforts(sample: ForceSample) -> list[float]:
    """Return the efforts in the order of their names."""
    return [*chain.from_iterable(sample.wrenches), *sample.quantities.values]


def to_step(sample: ForceSample, marks: tuple[Row, ...] = ()) -> StepMessage:
    """Return the sample as a step message, with the rows the publishing node adds."""
    more = marks
    if sample.loads:
        more = (*(row for i, load in enumerate(sample.loads) for row in _load_rows(i, load)), *marks)
    names = _row_names(sample.pins, sample.quantities.names, sample.residuals.names, tuple([row[0] for row in more]))
    effort = efforts(sample)
    before = (0.0,) * len(effort)
    after = (0.0,) * (1 + len(sample.residuals.values))
    return StepMessage(
        Header(stamp_of(sample.time_s)),
        names,
        (*before, float(sample.step), *after, *[row[1] for row in more]),
        (*before, sample.time_s, *after, *[row[2] for row in more]),
        (*effort, 0.0, sample.body_moment_nm, *sample.residuals.values, *[row[3] for row in more]),
    )


@of_the_same
def _form(pins: Names, quantities: Names, residuals: Names, marks: Names) -> RowForm:
    names = _row_names(pins, quantities, residuals, marks)
    own, checked, said = len(effort_names(pins, quantities)), len(residuals), len(marks)
    step = f"{NUMBER * own}xd{NUMBER * (1 + checked)}x{said}d"
    return row_form(names, step, step, f"{own}d{NUMBER}x{1 + checked + said}d")


def to_bytes(sample: ForceSample, marks: tuple[Row, ...] = ()) -> bytes:
    """Return the bytes of the sample as a step message."""
    if sample.loads:
        return encoded(to_step(sample, marks))
    residuals = sample.residuals
    form = _form(sample.pins, sample.quantities.names, residuals.names, mark_names(marks))
    position = (sample.step, *[row[1] for row in marks])
    velocity = (sample.time_s, *[row[2] for row in marks])
    effort = (*efforts(sample), sample.body_moment_nm, *residuals.values, *[row[3] for row in marks])
    return written(form, sample.time_s, position, velocity, effort)


def _load_rows(index: int, load: Load) -> list[Row]:
    head = f"{LOAD}{index}/{load.kind}/{load.contact}"
    values = (load.time_s, load.moment_before_nm, load.moment_after_nm, load.impulse_nms)
    return [Row(f"{head}/{column}", 0.0, 0.0, value) for column, value in zip(LOAD_COLUMNS, values, strict=True)]


def to_message(sample: ForceSample) -> JointState:
    """Return the sample as a message of the middleware."""
    return joint_state(to_step(sample))


class ForcePlaces(NamedTuple):
    """Where everything stands in a force message with these row names."""

    pins: tuple[str, ...]
    pin_rows: tuple[tuple[int, ...], ...]
    quantities: tuple[str, ...]
    quantity_rows: tuple[int, ...]
    loads: tuple[tuple[str, str, int], ...]
    pins_first: bool


@of_the_same
@lru_cache(maxsize=1024)
def _layout(names: tuple[str, ...]) -> ForcePlaces:
    plain = [name for name in names if not name.startswith(MARK)]
    pins = tuple(name.removesuffix("/force_x_n") for name in plain if name.endswith("/force_x_n"))
    of_pins = {f"{pin}/{component}" for pin in pins for component in COMPONENTS}
    missing = sorted(of_pins - set(plain))
    if missing:
        raise MessageError(f"row '{missing[0]}' is missing; a pin has {', '.join(COMPONENTS)}")
    quantities = tuple(name for name in plain if name not in of_pins)
    loads = tuple(_load(names, row) for row, name in enumerate(names) if name.startswith(LOAD) and _is_head(name))
    rows = {name: row for row, name in enumerate(names)}
    pin_rows = tuple(tuple(rows[f"{pin}/{component}"] for component in COMPONENTS) for pin in pins)
    in_order = tuple(range(3 * len(pins))) == tuple(chain.from_iterable(pin_rows))
    return ForcePlaces(pins, pin_rows, quantities, tuple(rows[name] for name in quantities), loads, in_order)


def _wrenches(effort: Sequence[float], where: ForcePlaces) -> tuple[Wrench, ...]:
    end = 3 * len(where.pins)
    if where.pins_first:
        return tuple(map(Wrench, effort[0:end:3], effort[1:end:3], effort[2:end:3]))
    return tuple([Wrench(*[effort[row] for row in rows]) for rows in where.pin_rows])


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
    moment = content.layout.scalars.get(BODY_MOMENT)
    if moment is None:
        raise MessageError(f"row '{BODY_MOMENT}' is missing")
    return ForceSample(
        step,
        time_s,
        where.pins,
        _wrenches(effort, where),
        Named(where.quantities, tuple([effort[i] for i in where.quantity_rows])),
        effort[moment],
        Named(content.layout.residuals, tuple([effort[i] for i in content.layout.residual_rows])),
        tuple([Load(effort[i], kind, contact, *effort[i + 1 : i + 4]) for kind, contact, i in where.loads]),
    )


def wrench_bytes(time_s: float, frame: str, wrench: Wrench) -> bytes:
    """Return the bytes of `wrench_message`."""
    return stamped_bytes(time_s, frame, (wrench.force_x_n, wrench.force_y_n, 0.0, 0.0, 0.0, wrench.moment_nm))


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
