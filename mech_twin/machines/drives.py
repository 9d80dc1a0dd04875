"""Drive of a crank: a speed that is prescribed, or an induction motor; shared by the machines that have one.

::

    supply (command -1..1) --> motor --(gear, ratio i, efficiency eta)--> crank, angle f counter-clockwise
        constant speed:  crank speed = command * rated speed, whatever torque that takes
        kloss:           M_motor = torque(i * crank speed, command); a negative command is a reversed phase order

The command moves toward the asked fraction of rated supply frequency by at most ``rate_per_s`` a second.  With a
prescribed speed that rate limits the speed itself too, so that a rated speed changed while running is reached at the
same rate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from typing import Literal

from pydantic import field_validator

from mech_twin.engine.crank_linkage import ShaftFriction
from mech_twin.parts.friction import Friction
from mech_twin.parts.induction_motor import MotorConstants, motor_torque
from mech_twin.parts.supply import limited_change, limited_command
from mech_twin.quantity import Parameters, choice, quantity
from mech_twin.samples import LinkageSample, MotorSample

# steps of the speed at a prescribed rate are sums of rounded terms: what rounding leaves must not cost a step
ROUNDING = 1.0 + 1e-9


class Drive(Parameters):
    """Drive of the crank."""

    kind: Literal["constant_speed", "kloss"] = choice("prescribed crank speed, or induction motor behind a gear")
    speed_rpm: float = quantity("rpm", "rated crank speed, positive counter-clockwise; not zero", live=True)

    @field_validator("speed_rpm")
    @classmethod
    def _turning(cls, value: float) -> float:
        if value == 0.0:
            raise ValueError("speed_rpm must not be 0: every figure of a cycle is taken at this speed")
        return value

    @property
    def speed_rad_per_s(self) -> float:
        """Rated crank speed in rad/s."""
        return self.speed_rpm * pi / 30.0


@dataclass(frozen=True)
class PrescribedSpeed:
    """Motor that gives a driven joint a speed, whatever effort that takes.

    Attributes
    ----------
    speed : float
        Speed at full command, in the unit of the driven joint per second.
    rate_per_s : float
        Largest change of the command in a second (1/s); times ``speed`` that of the speed.
    step_s : float
        Coupling step (s).
    driven : int
        Place of the driven joint in the linkage sample.
    let_go : int or None
        Regime in which the linkage no longer follows the drive: the drive then runs on at its command.
    """

    speed: float
    rate_per_s: float
    step_s: float
    driven: int = 0
    let_go: int | None = None
    joints: tuple[str, ...] = ("motor",)

    def respond(self, linkage: LinkageSample, target: float) -> MotorSample:
        """Return the speed asked of the linkage at the end of the step, and the effort it takes now."""
        command = limited_command(linkage.command, target, self.rate_per_s, self.step_s)
        speed = command * self.speed
        if linkage.regime != self.let_go:
            reach = abs(self.speed) * self.rate_per_s * self.step_s * ROUNDING
            speed = limited_change(linkage.velocity[self.driven], speed, reach)
        return MotorSample(
            linkage.step,
            linkage.time_s,
            self.joints,
            (linkage.position[self.driven],),
            (speed,),
            (linkage.effort[self.driven],),
            command,
        )


def shaft_friction(friction: Friction) -> ShaftFriction:
    """Return the constants of a crank shaft's friction."""
    return ShaftFriction(friction.coulomb_nm, friction.viscous_nms_per_rad)


def first_joint(linkage: LinkageSample) -> tuple[float, float]:
    """Return angle (rad) and speed (rad/s) of the linkage's first joint."""
    return linkage.position[0], linkage.velocity[0]


@dataclass(frozen=True)
class KlossDrive:
    """Induction motor behind a gear: its torque follows from its speed and the supply, it has no state of its own.

    Attributes
    ----------
    motor : MotorConstants
        Torque against slip.
    ratio : float
        Motor speed over the speed of the driven shaft.
    rate_per_s : float
        Largest change of the supply fraction in a second (1/s).
    step_s : float
        Coupling step (s).
    shaft : callable
        ``shaft(linkage)``: angle (rad) and speed (rad/s) of the shaft behind the gear, seen from the motor's housing.
    direction : float
        +1, or -1 where the phases are swapped so that the machine runs backward; the command takes this sign.
    """

    motor: MotorConstants
    ratio: float
    rate_per_s: float
    step_s: float
    shaft: Callable[[LinkageSample], tuple[float, float]] = first_joint
    direction: float = 1.0
    joints: tuple[str, ...] = ("rotor",)

    def respond(self, linkage: LinkageSample, target: float) -> MotorSample:
        """Return rotor angle, rotor speed and shaft torque at the linkage's step."""
        asked = self.direction * min(max(target, 0.0), 1.0)
        command = limited_change(linkage.command, asked, self.rate_per_s * self.step_s)
        angle, speed = self.shaft(linkage)
        rotor = self.ratio * speed
        return MotorSample(
            linkage.step,
            linkage.time_s,
            self.joints,
            (self.ratio * angle,),
            (rotor,),
            (motor_torque(self.motor, rotor, command),),
            command,
        )
