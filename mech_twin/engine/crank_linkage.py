# SPDX-License-Identifier: Apache-2.0
"""Crank-driven linkage with one degree of freedom: prescribed speed or motor torque, with exact changes of regime.

Here is one coupling step as rows of numbers, and the force analysis, checked by two independent computations of the
drive torque.  The motion is in `crank_motion`; the mechanism is given by the kernels listed in `crank_state`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import isnan
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.compiled_roles import CompiledLinkage, failed
from mech_twin.engine.compiled_steps import Work, linkage_step, step_of, work_room
from mech_twin.engine.crank_motion import (
    ANGLE,
    BEGIN_ROOM,
    CRANK_LAW,
    DRIVE_WORK,
    FRICTION_LOSS,
    GEAR_LOSS,
    KINDS,
    LOAD_WORK,
    MECHANISM_REGIME,
    SPEED,
    STALLED_1,
    STATE_SIZE,
    TURNED,
    TURNED_BACK,
    TurningCrank,
    fill_tolerance,
    held_shares,
    load_torque,
    note_stall,
    sign_of,
    turned_over,
    turning_sense,
)
from mech_twin.engine.crank_state import (
    MEMORY_SIZE,
    NO_FRICTION,
    TURN,
    Boundary,
    Crank,
    Memory,
    Resisting,
    ShaftFriction,
    Transmission,
    count_torque_energy,
    crank_drive,
    fill_memory,
    mechanism_state,
    memory_of,
    shaft_drive,
    under_load_share,
    within_a_turn,
)
from mech_twin.engine.hybrid.laws import Array, regime_of
from mech_twin.engine.hybrid.loop import (
    CONTRADICTS,
    MOST_PIECES,
    MOST_STEPS,
    TOO_LONG,
    TOO_MANY,
    UNSTEADY,
    advance,
    room_in,
    room_sizes,
)
from mech_twin.engine.hybrid.motion import find_accelerations
from mech_twin.engine.hybrid.type_erasure import declared
from mech_twin.engine.integration import DORMAND_PRINCE_5
from mech_twin.engine.sample_vectors import (
    COMMAND,
    LINKAGE_JOINTS,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    REGIME,
    EventLayout,
    LinkageLayout,
)
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.roles import CrankState
from mech_twin.samples import LinkageSample

FORCE_RESIDUALS, FORCE_LIMITS = ("drive_torque_routes",), {"drive_torque_routes": 1e-10}
NO_TORQUE = -5
FAILURES = {
    TOO_MANY: f"more than {MOST_PIECES} changes of regime; expected fewer: shorten coupling.step_s, or soften friction "
    "and load",
    UNSTEADY: "no integration step of 1e-13 s or more is small enough for the crank; friction, load or speed change "
    "too fast, or the mechanism does not turn through",
    TOO_LONG: f"coupling.step_s = {{step_s:g}} s takes more than {MOST_STEPS} steps of integration, "
    "loads are large for the crank's inertia; try {shorter_s:g}",
    CONTRADICTS: "the friction at the crank contradicts itself",
    NO_TORQUE: "the crank torque is not finite",
}
CRANK = "crank"  # the joint whose angle is integrated
SCALE_ANGLES = 72
RESIDUALS = ("loop_closure_m", "energy_balance")


@kernel
def route_miss(drive_nm: float, torque_nm: float, inertia: float, memory: Memory, scale_nm: float) -> float:
    """Return the relative difference of two computations of the drive torque.

    Its scale is the largest of the cycle's peak, the present torque and the inertia torque.

    Parameters
    ----------
    drive_nm, torque_nm : float
        Torque at the crank from the equilibrium of the links, and from the linkage's row, with friction (N m).
    inertia : float
        Inertia of the mechanism reduced to its crank (kg m2).
    memory : Memory
        Memory in the linkage's row.
    scale_nm : float
        Largest torque of a cycle (N m).
    """
    scale = max(scale_nm, abs(torque_nm), inertia * abs(memory.crank_acceleration_rad_per_s2), 1e-9)
    return (drive_nm - torque_nm - memory.friction_torque_nm) / scale


def failures_at(step_s: float) -> tuple[str, ...]:
    """Return the messages of the failures, for a coupling step (s)."""
    return tuple(FAILURES[-1 - i].format(step_s=step_s, shorter_s=0.1 * step_s) for i in range(len(FAILURES)))


class TurnedCrank(NamedTuple):
    """A crank linkage: its constants, and those of its mechanism."""

    crank: Crank
    mechanism: Any


@kernel
def fill_row(
    model: TurnedCrank, y: Array, turned: float, sense: float, regime: int, memory: Memory, command: float, out: Array
) -> bool:
    """Fill a linkage row from a state; return whether the crank torque is finite.

    ``memory`` lacks sense, drive work, losses, kinetic friction and energy; a nan initial energy marks the start.
    """
    crank, mechanism = model.crank, under_load_share(model.mechanism, memory.load_share)
    w, e = y[SPEED], memory.crank_acceleration_rad_per_s2
    positions, velocities, torque, energy, closure = mechanism_state(mechanism, turned, w, e, regime)
    friction, booked = memory.friction_torque_nm, memory.adjustment_work_j
    if sense != 0.0:
        friction = -crank.friction.coulomb_nm * sense - crank.friction.viscous_nms_per_rad * w
    initial = energy if math.isnan(memory.initial_energy_j) else memory.initial_energy_j
    miss = energy - initial - y[DRIVE_WORK] - memory.load_work_j + y[FRICTION_LOSS] - booked
    scale = max(turned_over(y, memory.load_work_j), abs(initial), abs(energy), abs(booked), crank.energy_scale_j)
    out[REGIME], out[COMMAND] = regime, command
    at = LINKAGE_JOINTS
    for i in range(len(positions)):
        out[at], out[at + 1], out[at + 2] = positions[i], velocities[i], 0.0
        at += 3
    out[LINKAGE_JOINTS + 2] = torque - friction
    memory = Memory(
        e, friction, sense, memory.stalled_1, memory.load_share, memory.turned_back_rad, y[DRIVE_WORK], y[GEAR_LOSS],
        y[FRICTION_LOSS], memory.load_work_j, booked, energy, initial,
    )  # fmt: skip
    fill_memory(memory, out, len(positions))
    at += MEMORY_SIZE
    out[at], out[at + 1] = closure, miss / scale
    return math.isfinite(torque)


@kernel
def start_row(model: TurnedCrank, f: float, w: float, e: float, command: float, regime: int, out: Array) -> bool:
    """Fill the row of a crank from angle, speed, acceleration (rad, s); return whether its torque is finite.

    At rest friction carries the load up to its limit.
    """
    y, held, coulomb = np.zeros(STATE_SIZE), 0.0, model.crank.friction.coulomb_nm
    y[ANGLE], y[SPEED] = f, w
    if w == 0.0 and e == 0.0:
        held = min(max(load_torque(model.mechanism, f, regime), -coulomb), coulomb)
    memory = Memory(e, held, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan)
    return fill_row(model, y, f, sign_of(w), regime, memory, command, out)


@step_of(work_room, TurnedCrank, borrowing_kernel)
def room_of_step(model: TurnedCrank) -> tuple[int, int]:
    """Return the lengths of the work arrays of `crank_step`."""
    size, places = room_sizes(1, 1, 1, STATE_SIZE)
    return BEGIN_ROOM + size, 2 + places


@step_of(linkage_step, TurnedCrank, borrowing_kernel)
def crank_step(
    model: TurnedCrank, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array, work: Work
) -> int:
    """Fill ``out`` with the linkage one step later; changes of regime and stops are located within the step."""
    crank, y, kept = model.crank, work.numbers[:STATE_SIZE], work.numbers[STATE_SIZE:BEGIN_ROOM]
    regimes = work.marks[:2]
    f, w, regime = linkage[LINKAGE_JOINTS], linkage[LINKAGE_JOINTS + 1], int(linkage[REGIME])
    joints, _, energy = count_torque_energy(model.mechanism, f, w, 0.0, regime)
    past = memory_of(linkage, joints)
    command, speed, torque = motor[MOTOR_COMMAND], motor[MOTOR_JOINTS + 1], motor[MOTOR_JOINTS + 2]
    e, sense = (speed - w) / crank.step_s, past.turning_sense
    if crank.drive.prescribed:
        sense = sign_of(w) if w != 0.0 else sign_of(e)
    drive = shaft_drive(crank, step * crank.step_s, w, linkage[COMMAND], torque, command)
    y[ANGLE], y[SPEED], y[DRIVE_WORK] = within_a_turn(f), w, past.drive_work_j
    y[GEAR_LOSS], y[FRICTION_LOSS] = past.gear_loss_j, past.friction_loss_j
    kept[TURNED], kept[LOAD_WORK], kept[STALLED_1], kept[TURNED_BACK] = (
        f, past.load_work_j, past.stalled_1, past.turned_back_rad,
    )  # fmt: skip
    regimes[CRANK_LAW], regimes[MECHANISM_REGIME] = regime_of(sense), regime
    motion = TurningCrank(model, drive, e, command, kept)
    room = room_in(work.numbers[BEGIN_ROOM:], work.marks[2:], 1, 1, 1, STATE_SIZE, DORMAND_PRINCE_5)
    system = declared(motion, room.at)
    fill_tolerance(model, y, past.crank_acceleration_rad_per_s2, regime, past.load_work_j, room.tolerance)
    count = note_stall(motion, system, y, regimes, room, log)
    count = advance(system, 0.0, crank.step_s, y, regimes, room, log, count)
    if count < 0:
        return count
    if crank.drive.prescribed:
        y[SPEED] = speed
    find_accelerations(system, crank.step_s, y, regimes, room.at)
    held, share, sense = 0.0, 1.0, turning_sense(regimes[CRANK_LAW])
    if sense == 0.0:
        held, share = held_shares(motion, y, regimes, room.at)
    memory = Memory(
        room.at.acceleration[0] if sense != 0.0 else 0.0, held, 0.0, kept[STALLED_1], share, kept[TURNED_BACK], 0.0,
        0.0, 0.0, kept[LOAD_WORK], past.adjustment_work_j + energy - past.energy_j, 0.0, past.initial_energy_j,
    )  # fmt: skip
    finite = fill_row(model, y, kept[TURNED], sense, regimes[MECHANISM_REGIME], memory, command, out)
    return count if finite else NO_TORQUE


@dataclass(frozen=True)
class CrankLinkage(CompiledLinkage):
    """Linkage driven at its crank; ``transmission`` is None for a prescribed speed.

    ``mechanism`` holds constants of a type for which the functions of `crank_state` are declared.
    """

    mechanism: Any
    step_s: float
    start_angle: float
    start_speed: float
    start_command: float
    joints: tuple[str, ...]
    contact: str
    regimes: tuple[str, ...] = ("free",)
    start_regime: int = 0
    boundaries: tuple[Boundary, ...] = ()
    transmission: Transmission | None = None
    friction: ShaftFriction = NO_FRICTION
    coordinates: tuple[str, ...] = (CRANK,)
    size_m: float = 1.0
    resisting: Mapping[int, Resisting] = field(default_factory=dict)
    energy_scale_j: float = 0.0

    @property
    def failures(self) -> tuple[str, ...]:
        """Messages of the failures of a step."""
        return failures_at(self.step_s)

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limits of the residuals: loop closure (m, times the size of a linkage beyond 1 m), energy balance."""
        return {"loop_closure_m": 1e-12 * max(1.0, self.size_m), "energy_balance": 1e-8}

    def at_rated_speed(self, speed_rad_per_s: float) -> CrankLinkage:
        """Return this linkage with its energy balance scaled by at least the largest energy (J) of a turn at a speed.

        At rest the energies alone would be too small a scale.
        """
        angles = (TURN * i / SCALE_ANGLES for i in range(SCALE_ANGLES))
        speed, regime = float(speed_rad_per_s), self.start_regime
        energies = [mechanism_state(self.mechanism, f, speed, 0.0, regime)[3] for f in angles]
        return replace(self, energy_scale_j=max(map(abs, energies)))

    @cached_property
    def model(self) -> TurnedCrank:
        """Constants of the kernel."""
        kinds = self.layout.events.kinds
        rows = [(b.angle, b.direction, b.before, b.after, kinds.index(b.kind)) for b in self.boundaries]
        resisting = [(regime, load.sense, load.after) for regime, load in self.resisting.items()]
        crank = Crank(
            float(self.step_s),
            float(self.start_angle),
            np.array(rows, dtype=float).reshape(len(rows), 5),
            crank_drive(self.transmission),
            ShaftFriction(*map(float, self.friction)),
            np.array(resisting, dtype=float).reshape(len(resisting), 3),
            float(self.energy_scale_j),
        )
        return TurnedCrank(crank, self.mechanism)

    @cached_property
    def layout(self) -> LinkageLayout:
        """Row of the samples."""
        kinds = tuple(dict.fromkeys((*KINDS, *(boundary.kind for boundary in self.boundaries))))
        return LinkageLayout(
            self.joints, Memory._fields, RESIDUALS, EventLayout(kinds, (CRANK, self.contact), len(self.coordinates))
        )

    def start(self, step: int = 0) -> LinkageSample:
        """Return the linkage at its initial angle and speed; at rest it is held until the first motor sample."""
        out, speed, command = np.empty(self.layout.size), float(self.start_speed), float(self.start_command)
        if not start_row(self.model, float(self.start_angle), speed, 0.0, command, self.start_regime, out):
            raise failed(self.failures, NO_TORQUE, step * self.step_s)
        return self.layout.sample(step, step * self.step_s, out.tolist(), ())

    def guided(self, step: int, time_s: float, motion: CrankState) -> LinkageSample:
        """Return the linkage in a measured motion of its crank, with the crank torque by inverse dynamics."""
        f, w, e = map(float, motion[:3])
        out, regime = np.empty(self.layout.size), self._regime_at(f, sign_of(w))
        if not start_row(self.model, f, w, e, float(self.start_command), regime, out):
            raise failed(self.failures, NO_TORQUE, time_s)
        return self.layout.sample(step, time_s, out.tolist(), ())

    def _regime_at(self, f: float, sense: float) -> int:
        """Return the regime at an angle (rad) reached in this sense of rotation: that of the last boundary passed."""
        passed = [
            (TURN * ((sense * (f - boundary.angle) / TURN) % 1.0), boundary.after)
            for boundary in self.boundaries
            if boundary.direction == sense and not isnan(boundary.angle)
        ]
        return min(passed)[1] if passed else self.start_regime
