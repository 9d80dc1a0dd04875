# SPDX-License-Identifier: Apache-2.0
"""Generated functions of a page, its initial state, and the constants of its drives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.machines.page.elements import RPM, DriveElement
from mech_twin.machines.page.equations import PageInstant
from mech_twin.machines.page.force_laws import PageNumbers
from mech_twin.machines.page.state_places import StatePlaces
from mech_twin.machines.page.step import DC, DRIVE_WIDTH, EFFORT, INDUCTION, MOTOR_NUMBERS, PROGRAM, SPEED, TABLE
from mech_twin.mechanics.recording import Number, Recording
from mech_twin.mechanics.straight_line import Generated, generated
from mech_twin.parts.induction_motor import motor_constants

Array = NDArray[np.float64]


class Functions(NamedTuple):
    """The generated functions of a page, its numbers, and the names of the results."""

    instant: Generated
    correction: Generated
    report: Generated
    reactions: Generated
    numbers: tuple[float, ...]
    pins: tuple[str, ...]
    quantities: tuple[str, ...]


def functions_of(places: StatePlaces) -> Functions:
    """Return the functions of a page, generated for its structure."""
    recording = Recording()
    number = PageNumbers(recording)
    controls: list[Number] = [recording.leaf(f"controls[{i}]") for i in range(places.controls)]
    state: list[Number] = [recording.leaf(f"state[{i}]") for i in range(places.state)]
    now = PageInstant(places, number, controls, recording.leaf("t"), state)
    reactions = now.reactions()
    wrenches = [x for wrench in reactions.pins.values() for x in wrench]
    made = generated(
        {
            "instant": now.equations(),
            "correction": now.correction(),
            "report": [*now.joint_motion(), *now.energies(), *(now.at_full_supply[name] for name in places.tabled)],
            "reactions": [*wrenches, *reactions.quantities.values(), *reactions.lack, *reactions.sizes],
        }
    )
    return Functions(
        made["instant"], made["correction"], made["report"], made["reactions"], tuple(number.values),
        tuple(reactions.pins), tuple(reactions.quantities),
    )  # fmt: skip


def start_state(places: StatePlaces) -> list[float]:
    """Return the state at the start, with all work integrals zero."""
    assembly = places.assembly
    split, s, speeds = assembly.split, assembly.start, assembly.start_speeds
    n = places.free
    return [
        *(float(s[j]) for j in split.free), *map(float, speeds[:n]), *(float(s[j]) for j in split.dependent),
        *(float(s[j]) for j in split.driven), *map(float, speeds[n:]), *[0.0] * len(places.books),
        *[1.0] * len(places.gases),
    ]  # fmt: skip


def drive_row(drive: DriveElement, places: StatePlaces, name: str) -> Array:
    """Return the constants of a drive for the kernels."""
    row = np.zeros(DRIVE_WIDTH)
    column, ratio = places.assembly.columns.index(drive.joint), drive.gear_ratio or 1.0
    first = second = switched = 0.0
    kind = {
        "constant_speed": SPEED,
        "program": PROGRAM,
        "table": TABLE,
        "dc_motor": DC,
        "induction_motor": INDUCTION,
    }.get(drive.kind, EFFORT)
    if kind == SPEED:
        first = (drive.speed_rpm or 0.0) * RPM if drive.speed_m_per_s is None else drive.speed_m_per_s
    elif kind == EFFORT:
        first = drive.torque_nm if drive.torque_nm is not None else drive.force_n or 0.0
    elif kind == PROGRAM:
        first, second = drive.levels_n or drive.levels_nm or (0.0, 0.0)
        switched = places.switches.index(name)
    elif kind == TABLE:
        switched = places.tabled.index(name)
    elif kind == DC:
        first, second = drive.stall_torque_nm or 0.0, (drive.no_load_speed_rpm or 0.0) * RPM
    row[:MOTOR_NUMBERS] = kind, column, ratio, first, second, switched
    if drive.motor is not None:
        row[MOTOR_NUMBERS:] = [float(x) for x in motor_constants(drive.motor)]
    return row
