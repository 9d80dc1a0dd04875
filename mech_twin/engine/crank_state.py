"""What a crank linkage is made of: its mechanism as kernels, the boundaries of its load, drive, friction and state."""

from __future__ import annotations

from collections.abc import Callable
from math import fmod, inf, pi
from typing import Any, NamedTuple

from mech_twin.engine.crank_motion import ShaftDrive
from mech_twin.parts.induction_motor import MotorConstants, motor_torque_slope
from mech_twin.samples import LinkageSample, MotorSample

TURN = 2.0 * pi
LARGE_ANGLE = 1e3  # rad: of a larger one, rounding in every step adds up


def within_a_turn(angle: float) -> float:
    """Return a large angle (rad) less whole turns, so that sums with it keep their digits; a small one as it is."""
    return angle if abs(angle) < LARGE_ANGLE else fmod(angle, TURN)


class Memory(NamedTuple):
    """State that is no joint: how the crank turns, and the energy balance."""

    crank_acceleration_rad_per_s2: float
    friction_torque_nm: float
    turning_sense: float  # +1, -1; 0 at rest
    stalled_1: float  # 1 where a supply that is on does not turn the crank
    load_share: float  # of the load that acts: less than 1 at rest against a load that only resists
    turned_back_rad: float  # crank angle at which it last turned back under such a load
    drive_work_j: float
    gear_loss_j: float
    friction_loss_j: float
    load_work_j: float
    adjustment_work_j: float  # by parameters changed while running
    energy_j: float
    initial_energy_j: float


class CrankKernels(NamedTuple):
    """The mechanism: ``constants`` first, then crank angle f (rad), rate w (rad/s), acceleration e (rad/s2).

    ``state(constants, f, w, e, regime)`` -> positions, velocities, crank torque (N m), energy (J), closure error (m)
    ``load_work(constants, f0, f1, regime)`` -> work (J) of the load on the way from f0 to f1
    ``load_speed(constants, f, w)`` -> speed (m/s) of the loaded point against the load, for events
    ``prescribed(constants, f, w, e, regime)`` -> system whose one rate is the power the drive gives the mechanism (W)
    ``driven(constants, shaft_drive, regime)`` -> system whose rates are `crank_rates`
    ``shared(constants, share)`` -> the constants with this share of the load
    """

    state: Callable[..., Any]
    load_work: Callable[..., float]
    load_speed: Callable[..., float]
    prescribed: Callable[..., Any]
    driven: Callable[..., Any]
    shared: Callable[..., Any]


class Boundary(NamedTuple):
    """A crank angle (rad, any turn) where the regime ``before`` becomes ``after``, met in this direction (+1, -1).

    The angle is nan where it is that at which the crank last turned back.
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
    """A regime whose load resists one sense of turning (+1, -1) and gives nothing back; ``after`` turning back."""

    sense: float
    after: int


class Transmission(NamedTuple):
    """Motor to crank: ratio, efficiency, rotor inertia (kg m2), the motor's curve (None: its torque is constant)."""

    ratio: float
    efficiency: float
    rotor_inertia_kg_m2: float
    motor: MotorConstants | None = None

    def drive(self, before: LinkageSample, motor: MotorSample, step_s: float, friction: ShaftFriction) -> ShaftDrive:
        """Return what turns the crank in the step after ``before``; no sense of turning is set yet."""
        slope, ramp, limit = 0.0, 0.0, inf
        (torque,), (rotor_speed,) = motor.effort, motor.velocity
        if self.motor is not None:
            slope = float(motor_torque_slope(self.motor, rotor_speed, motor.command))
            change = (motor.command - before.command) / step_s
            ramp = -self.motor.synchronous_speed_rad_per_s * slope * change
            limit = max(self.motor.breakdown_torque_nm, abs(torque))
        return ShaftDrive(
            self.ratio**2 * self.rotor_inertia_kg_m2,
            self.ratio,
            self.efficiency,
            torque,
            slope,
            ramp,
            before.joint("crank").velocity,
            limit,
            *friction,
            0.0,
        )


class State(NamedTuple):
    """What changes in a step: angle, speed, acceleration, sense of turning, works and losses (J), regime."""

    f: float
    w: float
    e: float
    sense: float
    drive_work: float
    gear_loss: float
    friction_loss: float
    load_work: float
    regime: int
    stalled: float = 0.0
    share: float = 1.0
    mark: float = 0.0


class Piece(NamedTuple):
    """A smooth piece of motion: the state after it, its duration (s), what ended it."""

    after: State
    span: float
    what: int
