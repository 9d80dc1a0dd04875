"""Linkage of the roller former: both masses, the elastic drive and all carts.  The motor is the shared `KlossDrive`."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from math import floor
from typing import NamedTuple

import numpy as np

from mech_twin.engine.errors import MotionError
from mech_twin.kernel import kernel
from mech_twin.machines.roller_former.cart_statics import cart_load, cart_motion, load_moment, rod_weight_moment
from mech_twin.machines.roller_former.dynamics import (
    Array,
    DriveLine,
    Former,
    FormerState,
    Modes,
    coupling_moment,
    geared,
    holds_at_rest,
    may_stick,
    state_array,
    state_of,
    stored_energy,
)
from mech_twin.machines.roller_former.events import EVENT_KINDS, EventLog, empty_log
from mech_twin.machines.roller_former.integration import DONE, Advance, advance_motion, ending
from mech_twin.machines.roller_former.memory import FormerMemory, next_memory
from mech_twin.samples import BodySample, Event, LinkageSample, MotorSample, Named

RESIDUALS = ("energy_balance", "rod_length")
KINK = 1e-9  # a second difference of the command above this is a corner: the torque before it tells nothing of after
TURN = 2.0 * np.pi


class Regime(IntEnum):
    """What the machine does; a sample holds the number."""

    running = 0
    held = 1
    stalled = 2


class FormerJoints(NamedTuple):
    """Positions, velocities or efforts of the joints by name: motor side at the crank, crank, twist, carts, rods."""

    drive: float
    crank: float
    twist: float
    carts: tuple[float, ...]
    rods: tuple[float, ...]


def joint_names(count: int) -> tuple[str, ...]:
    """Return the joints: motor side at the crank, crank, twist between them, then cart and rod of each crank."""
    carts = tuple(name for i in range(1, count + 1) for name in (f"cart_{i}", f"rod_{i}"))
    return ("drive", "crank", "twist", *carts)


def joints_of(values: tuple[float, ...]) -> FormerJoints:
    """Return the values of a sample's joints by name."""
    drive, crank, twist, *carts_and_rods = values
    return FormerJoints(drive, crank, twist, tuple(carts_and_rods[::2]), tuple(carts_and_rods[1::2]))


class CartJoints(NamedTuple):
    """Joints of carts and rods, cart 1, rod 1, cart 2, ...: (2 carts,) each; the worst miss of a rod's length."""

    position: Array
    velocity: Array
    effort: Array
    rod_length: float


@kernel
def load_in_force(former: Former, now: FormerState, modes: Modes) -> tuple[float, float]:
    """Return the sense and the share of the load that acts: where the crank is held, as much as holds it."""
    if modes.direction != 0.0:
        return modes.direction, modes.load_share
    rest = coupling_moment(former, now) - rod_weight_moment(former.bank, now.crank_rad)
    rest -= min(max(rest, -former.coulomb_nm), former.coulomb_nm)  # friction of the shaft carries first
    direction = 1.0 if rest >= 0.0 else -1.0
    if not holds_at_rest(former.bank):
        return direction, modes.load_share
    limit = load_moment(former.bank, now.crank_rad, direction)
    return direction, min(rest / limit, modes.load_share) if limit != 0.0 else 0.0


@kernel
def cart_joints(former: Former, y: Array, modes: Modes) -> CartJoints:
    """Return position, velocity and effort of carts and rods.

    The effort of a cart is the force of process and guide friction along x (N).
    """
    bank, now = former.bank, state_of(y)
    count = bank.offset_rad.size
    position, velocity, effort = np.zeros(2 * count), np.zeros(2 * count), np.zeros(2 * count)
    direction, share = load_in_force(former, now, modes)
    worst = 0.0
    for cart in range(count):
        psi = now.crank_rad + bank.offset_rad[cart]
        sine, cosine = np.sin(psi), np.cos(psi)
        motion = cart_motion(bank, sine, cosine)
        load = cart_load(bank, cart, now.crank_rad, direction)
        arm = bank.crank_m * sine * (motion.rod_cosine + bank.ratio * cosine)
        pull = load.rod_force_n if load.moment_nm * arm * load.rod_force_n >= 0.0 else -load.rod_force_n
        position[2 * cart], position[2 * cart + 1] = motion.x, np.arcsin(motion.rod_sine)
        velocity[2 * cart] = motion.x1 * now.crank_speed_rad_per_s
        velocity[2 * cart + 1] = bank.ratio * cosine / motion.rod_cosine * now.crank_speed_rad_per_s
        effort[2 * cart] = pull * motion.rod_cosine * share
        length = np.hypot(motion.x - bank.crank_m * cosine, bank.crank_m * sine)
        worst = max(worst, abs(length / bank.rod_m - 1.0))
    return CartJoints(position, velocity, effort, worst)


@kernel
def coupled_step(
    former: Former, torque: DriveLine, t: float, end_s: float, y: Array, modes: Modes, log: EventLog
) -> tuple[Advance, float, float]:
    """Advance one coupling step in place; return how, and the stored energy before and after it (J)."""
    sides = np.ones(former.bank.offset_rad.size)
    before = stored_energy(former, state_of(y), sides)
    advance = advance_motion(former, torque, t, end_s, y, modes, log, np.inf)
    return advance, before, stored_energy(former, state_of(y), sides)


@dataclass(frozen=True)
class FormerLinkage:
    """Both masses, the elastic drive and all carts; owner of all mechanical state.

    During a step the motor's torque is the straight line through its last two samples, which makes the coupling
    second order; it is held where there is no sample before, or the command has a corner.
    """

    former: Former
    step_s: float
    start_crank_rad: float
    start_speed_rad_per_s: float
    start_command: float
    joints: tuple[str, ...]
    coordinates: tuple[str, ...] = ("crank", "twist")
    regimes: tuple[str, ...] = tuple(regime.name for regime in Regime)

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the invariants; the expansion leaves (r/l)^4/8 of the rod's length open."""
        open_rod = 0.2 * self.former.bank.ratio**4 if self.former.bank.expanded else 1e-12
        return {"energy_balance": 1e-8, "rod_length": open_rod}

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine in its initial state: untwisted, the load on or still off as configured."""
        y = state_array(self.start_crank_rad, self.start_speed_rad_per_s)
        modes = start_modes(self.former, self.start_speed_rad_per_s)
        energy = stored_energy(self.former, state_of(y), np.ones(len(self.joints)))
        memory = FormerMemory(
            direction_1=modes.direction,
            load_on_1=float(modes.load_on),
            load_share_1=modes.load_share,
            stored_energy_j=energy,
        )
        return self._sample(step, y, modes, 0.0, self.start_command, memory, ())

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the linkage one coupling step later."""
        position, velocity = joints_of(linkage.position), joints_of(linkage.velocity)
        past = FormerMemory(*linkage.memory.values)
        y = np.array([position.crank, position.twist, velocity.crank, velocity.twist, 0.0, 0.0, 0.0, 0.0])
        (shaft,) = motor.effort
        change = motor.command - linkage.command
        smooth = past.torque_known_1 and abs(change - past.command_change_1) <= KINK
        smooth = smooth and min(motor.command, linkage.command) > 0.0
        slope = (shaft - past.motor_torque_nm) / self.step_s if smooth else 0.0
        torque = DriveLine(False, motor.command, shaft, slope, linkage.time_s)
        log, step = empty_log(), linkage.step + 1
        done, *energy = coupled_step(self.former, torque, linkage.time_s, step * self.step_s, y, past.modes, log)
        if done.status != DONE:
            raise MotionError(f"roller_former: {ending(done)}")
        now = FormerState(*y.tolist())
        turned = floor(now.crank_rad / TURN) != floor(position.crank / TURN)
        memory = next_memory(past, (shaft, change), done.modes, now, (energy[0], energy[1]), turned)
        events = tuple(
            Event(float(log.time_s[i]), EVENT_KINDS[log.kind[i]], "crank", period=int(log.turn[i]))
            for i in range(done.events)
        )
        at_end = shaft + slope * self.step_s
        return self._sample(step, y, done.modes, at_end, motor.command, memory, events)

    def _sample(
        self,
        step: int,
        y: Array,
        modes: Modes,
        shaft_nm: float,
        command: float,
        memory: FormerMemory,
        events: tuple[Event, ...],
    ) -> LinkageSample:
        former, now = self.former, FormerState(*y.tolist())
        carts = cart_joints(former, y, modes)
        transmitted = coupling_moment(former, now)
        held = modes.drive_direction == 0.0
        moment = transmitted if held else geared(former, shaft_nm, modes.drive_direction)
        first = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s
        elastic = former.stiffness_nm_per_rad * now.twist_rad
        scale = former.scales.motor_work_j + memory.turn_turnover_j
        regime = Regime.stalled if modes.stalled else Regime.held if modes.direction == 0.0 else Regime.running
        return LinkageSample(
            step,
            step * self.step_s,
            self.joints,
            (now.crank_rad + now.twist_rad, now.crank_rad, now.twist_rad, *carts.position.tolist()),
            (first, now.crank_speed_rad_per_s, now.twist_rate_rad_per_s, *carts.velocity.tolist()),
            (moment, transmitted, elastic, *carts.effort.tolist()),
            int(regime),
            command,
            Named(FormerMemory._fields, tuple(memory)),
            Named(RESIDUALS, (memory.turn_balance_error_j / scale, float(carts.rod_length))),
            events,
        )


def start_modes(former: Former, speed_rad_per_s: float) -> Modes:
    """Return the modes at the start: the load on or still off, the crank held where it rests under load or friction."""
    loaded = former.engage_speed_rad_per_s <= speed_rad_per_s
    modes = Modes(1.0, 1.0, 1.0, loaded, float(loaded), -1.0, False, 0.0)
    held = speed_rad_per_s == 0.0 and may_stick(former, modes)
    return modes._replace(direction=0.0) if held else modes
