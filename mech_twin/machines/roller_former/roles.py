"""Roles of the roller former: motor, linkage (both masses and all carts)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel
from mech_twin.machines.roller_former.cart_parameters import LOADS, OFFSET
from mech_twin.machines.roller_former.cart_statics import cart_load, cart_motion, load_moment
from mech_twin.machines.roller_former.dynamics import (
    CRANK,
    DAMPING_WORK,
    DIRECTION,
    ENGAGED,
    EVENT_ROWS,
    LOAD_WORK,
    MODES,
    MOTOR_WORK,
    SHARE,
    SLOW,
    SPEED,
    TWIST,
    TWIST_RATE,
    Former,
    Torque,
    coupling_moment,
    kinetic_and_elastic,
)
from mech_twin.machines.roller_former.events import EVENT_KINDS
from mech_twin.machines.roller_former.integration import FAILED, advance_motion
from mech_twin.parts.induction_motor import motor_torque
from mech_twin.parts.supply import limited_command
from mech_twin.samples import BodySample, Event, LinkageSample, MotorSample, Named

DRIVE_JOINT, CRANK_JOINT, TWIST_JOINT, CART_JOINTS = range(4)
RUNNING, HELD, STALLED_REGIME = range(3)
REGIMES = ("running", "held", "stalled")
MEMORY = (
    "motor_torque_nm",
    "torque_known_1",
    "command_change_1",
    "direction_1",
    "load_engaged_1",
    "load_share_1",
    "slow_s",
    "stalled_1",
    "motor_work_j",
    "damping_work_j",
    "load_work_j",
    "book_error_j",
)
RESIDUALS = ("energy_balance", "rod_length")
KINK = 1e-9  # a second difference of the command above this is a corner: the torque before it tells nothing of after


def joint_names(count: int) -> tuple[str, ...]:
    """Return the joints: motor side at the crank, crank, twist between them, then cart and rod of each crank."""
    carts = tuple(name for i in range(1, count + 1) for name in (f"cart_{i}", f"rod_{i}"))
    return ("drive", "crank", "twist", *carts)


@dataclass(frozen=True)
class FormerMotor:
    """Induction motor on the shaft: torque of speed and supply fraction, no state of its own."""

    former: Former
    rate_per_s: float
    step_s: float
    joints: tuple[str, ...] = ("rotor",)

    def respond(self, linkage: LinkageSample, target: float) -> MotorSample:
        """Return the motor at the linkage's speed, the supply moved towards the target."""
        command = limited_command(linkage.command, target, self.rate_per_s, self.step_s)
        ratio = self.former.ratio
        speed = linkage.velocity[DRIVE_JOINT] * ratio
        torque = motor_torque(self.former.motor, speed, command)
        place = (linkage.position[DRIVE_JOINT] * ratio,)
        return MotorSample(linkage.step, linkage.time_s, self.joints, place, (speed,), (torque,), command)


@kernel
def joint_rows(
    former: Former, y: NDArray[np.float64], modes: NDArray[np.float64], moment: float
) -> NDArray[np.float64]:
    """Return position, velocity and effort of every joint, shape (3, 3 + 2 carts); the rod closure in a last column.

    Efforts: motor moment at the crank, moment in the coupling, its elastic part, and on each cart the force of
    process and guide friction along x (N).
    """
    bank = former.bank
    count = bank.carts.shape[0]
    rows = np.zeros((3, CART_JOINTS + 2 * count + 1))
    transmitted = coupling_moment(former, y)
    rows[:, DRIVE_JOINT] = y[CRANK] + y[TWIST], y[SPEED] + y[TWIST_RATE], moment
    rows[:, CRANK_JOINT] = y[CRANK], y[SPEED], transmitted
    rows[:, TWIST_JOINT] = y[TWIST], y[TWIST_RATE], former.stiffness_nm_per_rad * y[TWIST]
    direction, share = modes[DIRECTION], modes[SHARE]
    if direction == 0.0:
        direction = 1.0 if transmitted >= 0.0 else -1.0
        limit = load_moment(bank, y[CRANK], direction)
        share = min(transmitted / limit, share) if limit != 0.0 else 0.0
    for cart in range(count):
        sine, cosine = np.sin(y[CRANK] + bank.carts[cart, OFFSET]), np.cos(y[CRANK] + bank.carts[cart, OFFSET])
        motion = cart_motion(bank, sine, cosine)
        load = cart_load(bank, cart, y[CRANK], direction)
        arm = bank.crank_m * sine * (motion.rod_cosine + bank.ratio * cosine)
        pull = load.rod_force_n if load.moment_nm * arm * load.rod_force_n >= 0.0 else -load.rod_force_n
        column = CART_JOINTS + 2 * cart
        rows[:, column] = motion.x, motion.x1 * y[SPEED], pull * motion.rod_cosine * share
        rows[0, column + 1] = np.arcsin(motion.rod_sine)
        rows[1, column + 1] = bank.ratio * cosine / motion.rod_cosine * y[SPEED]
        closure = np.hypot(motion.x - bank.crank_m * cosine, bank.crank_m * sine) / bank.rod_m - 1.0
        rows[0, -1] = max(rows[0, -1], abs(closure))
    return rows


@kernel
def coupled_step(
    former: Former, torque: Torque, t: float, end_s: float, y: NDArray[np.float64], modes: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], int, float]:
    """Advance one coupling step in place; return joints, events, their number, and the error of the energy book (J)."""
    events = np.zeros((EVENT_ROWS, 3))
    sides = np.ones(former.bank.carts.shape[0])
    before = kinetic_and_elastic(former, y, sides)
    _, count = advance_motion(former, torque, t, end_s, y, modes, events, np.inf)
    after = kinetic_and_elastic(former, y, sides)
    book = after - before - y[MOTOR_WORK] + y[DAMPING_WORK] + y[LOAD_WORK]
    last = (torque.value_nm + torque.slope_nm_per_s * (end_s - torque.origin_s)) * former.ratio * former.efficiency
    return joint_rows(former, y, modes, last), events, count, book


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
    regimes: tuple[str, ...] = REGIMES

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limits of the running proofs; the expansion leaves (r/l)^4/8 of the rod's length open."""
        open_rod = 0.2 * self.former.bank.ratio**4 if self.former.bank.expanded else 1e-12
        return {"energy_balance": 1e-8, "rod_length": open_rod}

    def start(self, step: int = 0) -> LinkageSample:
        """Return the machine in its initial state: untwisted, the load on or still off as configured."""
        y = np.array([self.start_crank_rad, 0.0, self.start_speed_rad_per_s, 0.0, 0.0, 0.0, 0.0])
        modes = np.zeros(MODES)
        loaded = self.former.engage_speed_rad_per_s <= self.start_speed_rad_per_s
        holding = (
            loaded and LOADS[self.former.bank.load] in {"reversing", "resist"} and self.start_speed_rad_per_s == 0.0
        )
        modes[[DIRECTION, ENGAGED, SHARE, SLOW]] = 0.0 if holding else 1.0, loaded, loaded, -1.0
        memory = (0.0, 0.0, 0.0, *modes[:5].tolist(), 0.0, 0.0, 0.0, 0.0)
        return self._sample(step, joint_rows(self.former, y, modes, 0.0), self.start_command, memory, ())

    def advance(self, linkage: LinkageSample, motor: MotorSample, body: BodySample | None) -> LinkageSample:
        """Return the linkage one coupling step later."""
        position, velocity, past = linkage.position, linkage.velocity, linkage.memory.values
        y = np.array(
            [position[CRANK_JOINT], position[TWIST_JOINT], velocity[CRANK_JOINT], velocity[TWIST_JOINT], 0.0, 0.0, 0.0]
        )
        modes = np.array([*past[3:8], 0.0])
        step, shaft = linkage.step + 1, motor.effort[0]
        change = motor.command - linkage.command
        smooth = past[1] and abs(change - past[2]) <= KINK and min(motor.command, linkage.command) > 0.0
        slope = (shaft - past[0]) / self.step_s if smooth else 0.0
        torque = Torque(False, motor.command, shaft, slope, linkage.time_s)
        rows, noted, count, book = coupled_step(self.former, torque, linkage.time_s, step * self.step_s, y, modes)
        if count == FAILED:
            raise ArithmeticError(f"no integration step is small enough at {linkage.time_s} s: {y.tolist()}")
        works = (past[8] + y[MOTOR_WORK], past[9] + y[DAMPING_WORK], past[10] + y[LOAD_WORK], past[11] + book)
        memory = (shaft, 1.0, change, *modes[:5].tolist(), *(float(work) for work in works))
        events = tuple(
            Event(float(noted[i, 0]), EVENT_KINDS[int(noted[i, 1])], "crank", period=int(noted[i, 2]))
            for i in range(count)
        )
        return self._sample(step, rows, motor.command, memory, events)

    def _sample(
        self,
        step: int,
        rows: NDArray[np.float64],
        command: float,
        memory: tuple[float, ...],
        events: tuple[Event, ...],
    ) -> LinkageSample:
        position, velocity, effort = rows[:, :-1].tolist()
        scale = self.former.scales[MOTOR_WORK] + abs(memory[8]) + abs(memory[10])
        regime = STALLED_REGIME if memory[7] else HELD if memory[3] == 0.0 else RUNNING
        return LinkageSample(
            step,
            step * self.step_s,
            self.joints,
            tuple(position),
            tuple(velocity),
            tuple(effort),
            regime,
            command,
            Named(MEMORY, memory),
            Named(RESIDUALS, (memory[11] / scale, float(rows[0, -1]))),
            events,
        )
