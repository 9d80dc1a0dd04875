# SPDX-License-Identifier: Apache-2.0
"""Drive of a crank: a speed that is prescribed, or an induction motor; shared by the machines that have one.

::

    supply (command -1..1) --> motor --(gear, ratio i, efficiency eta)--> crank, angle f counter-clockwise
        constant speed:  crank speed = command * rated speed, whatever torque that takes
        kloss:           M_motor = torque(i * crank speed, command); a negative command is a reversed phase order

The command moves toward the asked fraction of rated supply frequency by at most ``rate_per_s`` a second.  With a
prescribed speed that rate limits the speed itself too, so that a rated speed changed while running is reached at the
same rate.
"""

from collections.abc import Callable, Iterator, Mapping
from math import pi
from typing import Any, Literal, NamedTuple, Self

from pydantic import field_validator, model_validator

from mech_twin.declarations.quantity import Parameters, choice, quantity, upper
from mech_twin.engine.compiled_roles import EffortStepMotor, StepMotor
from mech_twin.engine.compiled_steps import motor_step, step_of
from mech_twin.engine.coupling import Coupling
from mech_twin.engine.crank_linkage import CrankLinkage
from mech_twin.engine.crank_state import ShaftFriction, Transmission
from mech_twin.engine.sample_vectors import (
    COMMAND,
    LINKAGE_JOINTS,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    REGIME,
    Array,
)
from mech_twin.kernels.kernel import kernel
from mech_twin.parts.friction_and_gear import Friction, Gear
from mech_twin.parts.induction_motor import (
    InductionMotorParameters,
    MotorConstants,
    SupplyParameters,
    limited_change,
    limited_command,
    motor_constants,
    motor_torque,
)
from mech_twin.roles import MotorRole

# steps of the speed at a prescribed rate are sums of rounded terms: what rounding leaves must not cost a step
ROUNDING = 1.0 + 1e-9
SLOWEST_RPM, FASTEST_RPM = 0.01, 1e4
LONGEST_TURN = 0.25  # of a turn, that a coupling step may take at prescribed speed
LONGEST_MOTOR_TURN = 0.05  # of a turn at the motor's synchronous speed
LONGEST_MOTOR_STEP_S = 0.01
OTHER_SPEED = 0.1  # of the rated speed: a motor that turns the crank further off is remarked on
MOST_STIFFNESS = 1e3  # step over the shortest time constant of the shaft


def root_between(function: Callable[[float], float], low: float, high: float) -> float:
    """Return a root of a function between ``low`` and ``high`` by bisection, to the nearest double.

    Raises
    ------
    ValueError
        If the function has the same sign at both ends.
    """
    at_low, at_high = function(low), function(high)
    if at_low == 0.0 or at_high == 0.0:
        return low if at_low == 0.0 else high
    if (at_low > 0.0) == (at_high > 0.0):
        raise ValueError(f"same sign at {low:.17g} and {high:.17g}: {at_low:g}, {at_high:g}")
    while True:
        middle = 0.5 * (low + high)
        value = function(middle)
        if value == 0.0 or not low < middle < high:
            return middle
        if (value > 0.0) == (at_low > 0.0):
            low = middle
        else:
            high = middle


class Drive(Parameters):
    """Drive of the crank."""

    kind: Literal["constant_speed", "kloss"] = choice("prescribed crank speed, or induction motor behind a gear")
    speed_rpm: float = quantity("rpm", "rated crank speed, positive counter-clockwise; not zero", live=True)

    @field_validator("speed_rpm")
    @classmethod
    def _turning(cls, value: float) -> float:
        if not SLOWEST_RPM <= abs(value) <= FASTEST_RPM:
            raise ValueError(
                f"speed_rpm must be {SLOWEST_RPM:g} to {FASTEST_RPM:g} either way round, and so must not be 0: every "
                "figure of a cycle is taken at this speed"
            )
        return value

    @property
    def speed_rad_per_s(self) -> float:
        """Rated crank speed in rad/s."""
        return self.speed_rpm * pi / 30.0


class DrivenCrank(Parameters):
    """Base of machines whose crank is driven at a prescribed speed, or by an induction motor behind a gear."""

    drive: Drive = choice("drive of the crank")
    motor: InductionMotorParameters | None = choice("motor of a kloss drive", default=None)
    gear: Gear | None = choice("gear of a kloss drive", default=None)
    supply: SupplyParameters = choice("supply of the drive")
    friction: Friction = choice("friction at the crank shaft", default=Friction())
    coupling: Coupling = choice("coupling of the roles")

    @model_validator(mode="after")
    def _drive_complete(self) -> Self:
        if self.drive.kind == "kloss" and (self.motor is None or self.gear is None):
            raise ValueError("drive.kind kloss needs both groups motor and gear")
        return self

    @model_validator(mode="after")
    def _step_is_short_enough(self) -> Self:
        step_s = self.coupling.step_s
        longest, why = LONGEST_TURN * 60.0 / abs(self.drive.speed_rpm), f"{LONGEST_TURN:g} turn at drive.speed_rpm"
        if self.drive.kind == "kloss" and self.motor is not None and self.gear is not None:
            turn_s = 60.0 * self.gear.ratio / self.motor.synchronous_speed_rpm
            curve = motor_constants(self.motor)
            slope = 2.0 * curve.breakdown_torque_nm / (curve.breakdown_slip * curve.synchronous_speed_rad_per_s)
            slope += self.friction.viscous_nms_per_rad / self.gear.ratio**2
            longest, why = min(
                (LONGEST_MOTOR_STEP_S, "the motor's slope is taken anew at each step"),
                (LONGEST_MOTOR_TURN * turn_s, f"{LONGEST_MOTOR_TURN:g} turn of the crank at synchronous speed"),
                (
                    MOST_STIFFNESS * (self.motor.rotor_inertia_kg_m2 / slope),
                    f"{MOST_STIFFNESS:g} times rotor inertia over the steepest slope of motor and viscous friction",
                ),
            )
        if step_s > longest:
            raise ValueError(f"coupling.step_s = {step_s:g} s must be at most {upper(longest, 4)} s: {why}")
        return self

    @property
    def motor_curve(self) -> MotorConstants | None:
        """Torque curve of the motor, None with a prescribed speed."""
        return None if self.drive.kind != "kloss" or self.motor is None else motor_constants(self.motor)

    def speed_remarks(self, numbers: Mapping[str, float]) -> Iterator[str]:
        """Yield a remark where the motor turns the crank at another speed than that of every figure of a cycle."""
        asked = abs(self.drive.speed_rpm)
        if self.motor_curve is not None and self.motor is not None and self.gear is not None:
            turned = self.motor.rated_speed_rpm / self.gear.ratio
            if abs(turned - asked) > OTHER_SPEED * asked:
                yield (
                    f"figures of a cycle and sizes are for drive.speed_rpm = {asked:g}; behind its gear the motor "
                    f"turns the crank at {turned:.4g} rpm"
                )

    @property
    def direction(self) -> float:
        """Sense of rotation of the crank: +1, or -1."""
        return 1.0 if self.drive.speed_rpm > 0.0 else -1.0

    def drive_roles(
        self, mechanism: Any, joints: tuple[str, ...], contact: str, size_m: float, **layer: Any
    ) -> tuple[MotorRole, CrankLinkage]:
        """Return the motor, and the crank linkage of a mechanism (see `CrankLinkage`) that it drives.

        With a motor the machine starts from rest.  The energy balance is scaled by at least the largest energy of a
        turn at full supply.
        """
        step_s, rate, command = self.coupling.step_s, self.supply.rate_per_s, self.supply.initial_fraction
        full = self.drive.speed_rad_per_s
        speed, transmission, curve = command * full, None, self.motor_curve
        role: MotorRole = prescribed_speed_motor(full, rate, step_s)
        if curve is not None and self.motor is not None and self.gear is not None:
            ratio, speed, command = self.gear.ratio, 0.0, self.direction * command
            full = curve.synchronous_speed_rad_per_s / ratio
            role = kloss_motor_role(KlossMotor(curve, ratio, rate, step_s, self.direction))
            transmission = Transmission(ratio, self.gear.efficiency, self.motor.rotor_inertia_kg_m2, curve)
        friction = ShaftFriction(self.friction.coulomb_nm, self.friction.viscous_nms_per_rad)
        linkage = CrankLinkage(
            mechanism, step_s, 0.0, speed, command, joints, contact, transmission=transmission, friction=friction,
            size_m=size_m, **layer,
        )  # fmt: skip
        return role, linkage.at_rated_speed(full)

    @property
    def drag_nm(self) -> float:
        """The drive torque (N m, signed) that overcomes the crank shaft's friction at the drive's speed."""
        speed = self.drive.speed_rad_per_s
        sense = (speed > 0.0) - (speed < 0.0)
        return self.friction.coulomb_nm * sense + self.friction.viscous_nms_per_rad * speed


class SpeedDrive(NamedTuple):
    """Constants of a motor that drives a joint at a prescribed speed.

    Attributes
    ----------
    speed : float
        Speed at full command, in the unit of the driven joint per second.
    rate_per_s : float
        Largest change of the command in a second (1/s); times ``speed`` that of the speed.
    step_s : float
        Coupling step (s).
    driven : int
        Place of the joint among those of the linkage.
    let_go : int
        Regime in which the linkage no longer follows the drive, which then runs freely at its command; -1 for none.
    """

    speed: float
    rate_per_s: float
    step_s: float
    driven: int
    let_go: int


@step_of(motor_step, SpeedDrive)
def prescribed_speed(model: SpeedDrive, linkage: Array, target: float, out: Array) -> None:
    """Fill ``out`` with the speed required of the linkage at the end of the step, and the present effort."""
    command = limited_command(linkage[COMMAND], target, model.rate_per_s, model.step_s)
    joint, speed = LINKAGE_JOINTS + 3 * model.driven, command * model.speed
    if linkage[REGIME] != model.let_go:
        reach = abs(model.speed) * model.rate_per_s * model.step_s * ROUNDING
        speed = limited_change(linkage[joint + 1], speed, reach)
    out[MOTOR_COMMAND] = command
    out[MOTOR_JOINTS], out[MOTOR_JOINTS + 1], out[MOTOR_JOINTS + 2] = linkage[joint], speed, linkage[joint + 2]


def prescribed_speed_motor(speed: float, rate_per_s: float, step_s: float) -> StepMotor:
    """Return the motor that drives the crank at a prescribed speed (rad/s), with whatever effort that requires."""
    return StepMotor(SpeedDrive(speed, rate_per_s, step_s, 0, -1), ("motor",))


class KlossMotor(NamedTuple):
    """Constants of an induction motor behind a gear: its torque is a function of speed and supply.

    Attributes
    ----------
    motor : MotorConstants
        Torque against slip.
    ratio : float
        Motor speed over the speed of the driven shaft, the linkage's first joint.
    rate_per_s : float
        Largest change of the supply fraction in a second (1/s).
    step_s : float
        Coupling step (s).
    direction : float
        +1, or -1 where the phases are swapped so that the machine runs backward; the command takes this sign.
    """

    motor: MotorConstants
    ratio: float
    rate_per_s: float
    step_s: float
    direction: float = 1.0


@kernel
def fill_motor(model: KlossMotor, before: float, angle: float, speed: float, target: float, out: Array) -> None:
    """Fill ``out`` with rotor angle, speed and torque at angle and speed (rad, rad/s) of the gear's output.

    ``before`` is the command of the step before.
    """
    asked = model.direction * min(max(target, 0.0), 1.0)
    command = limited_change(before, asked, model.rate_per_s * model.step_s)
    rotor = model.ratio * speed
    out[MOTOR_COMMAND] = command
    out[MOTOR_JOINTS], out[MOTOR_JOINTS + 1] = model.ratio * angle, rotor
    out[MOTOR_JOINTS + 2] = motor_torque(model.motor, rotor, command)


@step_of(motor_step, KlossMotor)
def kloss_motor(model: KlossMotor, linkage: Array, target: float, out: Array) -> None:
    """Fill ``out`` with rotor angle, speed and torque; the linkage's first joint is the gear's output."""
    fill_motor(model, linkage[COMMAND], linkage[LINKAGE_JOINTS], linkage[LINKAGE_JOINTS + 1], target, out)


def kloss_motor_role(model: KlossMotor) -> EffortStepMotor:
    """Return the motor role; the largest torque that can be commanded is the breakdown torque (N m)."""
    return EffortStepMotor(model, ("rotor",), float(model.motor.breakdown_torque_nm))
