# SPDX-License-Identifier: Apache-2.0
"""Parts of a crank linkage: its mechanism as kernels, the boundaries of its load, drive, friction and state."""

from math import copysign, pi
from typing import Any, NamedTuple

from mech_twin.engine.sample_vectors import LINKAGE_JOINTS, Array
from mech_twin.kernels.dispatcher import generic
from mech_twin.kernels.kernel import kernel
from mech_twin.parts.induction_motor import KLOSS, MotorConstants, MotorInStep, motor_in_step

TURN = 2.0 * pi
LARGE_ANGLE = 1e3  # rad: of a larger one, rounding in every step adds up


@kernel
def within_a_turn(angle: float) -> float:
    """Return an angle of 1e3 rad or more modulo 2 pi, which keeps digits in sums; a smaller one unchanged."""
    return angle if abs(angle) < LARGE_ANGLE else copysign(abs(angle) % TURN, angle)


class Memory(NamedTuple):
    """State besides the joints: sense of rotation, friction and load of the crank, and the energy balance."""

    crank_acceleration_rad_per_s2: float
    friction_torque_nm: float
    turning_sense: float  # +1, -1; 0 at rest
    stalled_1: float  # 1 if the crank rests although the supply is on
    load_share: float  # share of the load that acts: less than 1 at rest against a purely resisting load
    turned_back_rad: float  # crank angle at its last reversal under such a load
    drive_work_j: float
    gear_loss_j: float
    friction_loss_j: float
    load_work_j: float
    adjustment_work_j: float  # by parameters changed while running
    energy_j: float
    initial_energy_j: float


MEMORY_SIZE = len(Memory._fields)


@kernel
def memory_of(row: Array, joints: int) -> Memory:
    """Return the memory in a linkage row with this number of joints."""
    m = row[LINKAGE_JOINTS + 3 * joints :]
    return Memory(m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7], m[8], m[9], m[10], m[11], m[12])


@kernel
def fill_memory(memory: Memory, row: Array, joints: int) -> None:
    """Write the memory into a linkage row with this number of joints."""
    begin = LINKAGE_JOINTS + 3 * joints
    for i in range(MEMORY_SIZE):
        row[begin + i] = memory[i]


# The mechanism: functions of its constants, declared for their type with `compiled_steps.step_of`; crank angle f (rad),
# rate w (rad/s), acceleration e (rad/s2).


@generic()
def mechanism_state(mechanism: Any, f: float, w: float, e: float, regime: int) -> Any:
    """Return positions and velocities of the joints, crank torque (N m), energy (J), loop closure error (m)."""
    raise NotImplementedError


@kernel
def count_torque_energy(mechanism: Any, f: float, w: float, e: float, regime: int) -> tuple[int, float, float]:
    """Return number of joints, crank torque (N m) and energy (J); the other results of the mechanism are freed."""
    positions, _, torque, energy, _ = mechanism_state(mechanism, f, w, e, regime)
    return len(positions), torque, energy


@generic(kernel)
def mechanism_load_work(mechanism: Any, before: float, after: float, regime: int) -> float:
    """Return the work (J) of the load between two crank angles (rad); none if all loads have a potential."""
    return 0.0


@generic()
def mechanism_load_speed(mechanism: Any, f: float, w: float) -> float:
    """Return the speed (m/s) of the loaded point against the load, for events."""
    raise NotImplementedError


@generic()
def mechanism_drive_moment(mechanism: Any, f: float, w: float, e: float, regime: int) -> float:
    """Return the moment (N m) at the crank from the pin forces."""
    raise NotImplementedError


@generic()
def mechanism_reduced(mechanism: Any, f: float, regime: int) -> tuple[float, float, float]:
    """Return inertia (kg m2), its slope (kg m2/rad) and moment of weights and loads (N m), reduced to the crank."""
    raise NotImplementedError


@generic(kernel)
def under_load_share(mechanism: Any, share: float) -> Any:
    """Return the mechanism with this share of its load; unchanged if no load is purely resisting."""
    return mechanism


class Boundary(NamedTuple):
    """A crank angle (rad, any turn) where regime ``before`` becomes ``after`` when passed in ``direction`` (+1, -1).

    A nan angle stands for the angle of the crank's last reversal.
    """

    angle: float
    direction: float
    before: int
    after: int
    kind: str


class ShaftFriction(NamedTuple):
    """Friction at the crank shaft: Coulomb torque (N m), viscous coefficient (N m s/rad)."""

    coulomb_nm: float = 0.0
    viscous_nms_per_rad: float = 0.0


NO_FRICTION = ShaftFriction()


class Resisting(NamedTuple):
    """A load that resists one sense of rotation (+1, -1) and returns no energy; ``after``: the regime on reversal."""

    sense: float
    after: int


class Transmission(NamedTuple):
    """Motor to crank: gear ratio, efficiency, rotor inertia (kg m2), torque-speed curve (None: constant torque)."""

    ratio: float
    efficiency: float
    rotor_inertia_kg_m2: float
    motor: MotorConstants | None = None


NO_MOTOR = MotorConstants(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, KLOSS)


class CrankDrive(NamedTuple):
    """Kernel constants of a transmission; ``prescribed``: the speed is given, ``curved``: the motor has a curve."""

    prescribed: bool
    curved: bool
    ratio: float
    efficiency: float
    shaft_inertia_kg_m2: float
    motor: MotorConstants


def crank_drive(transmission: Transmission | None) -> CrankDrive:
    """Return the kernel constants of a transmission (None: prescribed speed)."""
    if transmission is None:
        return CrankDrive(True, False, 1.0, 1.0, 0.0, NO_MOTOR)
    ratio, motor = float(transmission.ratio), transmission.motor
    inertia = ratio**2 * transmission.rotor_inertia_kg_m2
    return CrankDrive(False, motor is not None, ratio, float(transmission.efficiency), inertia, motor or NO_MOTOR)


class Crank(NamedTuple):
    """Constants of a crank linkage beside its mechanism.

    ``boundaries`` (m, 5): angle, direction, regime before, regime after, kind of event; ``resisting`` (r, 3): regime,
    sense, regime after, as `Boundary` and `Resisting` name them.  The size of the energy balance is at least
    ``energy_scale_j``.
    """

    step_s: float
    start_rad: float
    boundaries: Array
    drive: CrankDrive
    friction: ShaftFriction
    resisting: Array
    energy_scale_j: float


class ShaftDrive(NamedTuple):
    """Drive and friction of the crank during one coupling step; t = 0 at its start.

    ``start_s`` is the time at the start (s).
    """

    shaft_inertia_kg_m2: float
    ratio: float
    efficiency: float
    motor: MotorInStep
    coulomb_nm: float
    viscous_nms_per_rad: float
    start_s: float


@kernel
def shaft_drive(crank: Crank, start_s: float, speed: float, before: float, torque: float, command: float) -> ShaftDrive:
    """Return the drive of the crank in a step.

    Parameters
    ----------
    start_s : float
        Time at the start of the step.
    speed, before : float
        Crank speed (rad/s) at the start of the step, and the command of the step before.
    torque, command : float
        The motor's torque (N m) and command.
    """
    drive, friction, given = crank.drive, crank.friction, command if crank.drive.curved else 0.0
    return ShaftDrive(
        drive.shaft_inertia_kg_m2,
        drive.ratio,
        drive.efficiency,
        motor_in_step(drive.motor, before, drive.ratio * speed, torque, given, crank.step_s),
        friction.coulomb_nm,
        friction.viscous_nms_per_rad,
        start_s,
    )
