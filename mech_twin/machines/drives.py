"""Drive of a crank: a speed that is prescribed, or an induction motor; shared by the machines that have one.

::

    supply (command 0..1) --> motor --(gear, ratio i, efficiency eta)--> crank, angle f counter-clockwise
        constant speed:  crank speed = command * rated speed, whatever torque that takes
        kloss:           M_motor = torque(i * crank speed, command)

The command moves toward the asked fraction of rated supply frequency by at most ``rate_per_s`` a second; with a
prescribed speed this rate limit is what gives the crank its acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Literal

from pydantic import field_validator

from mech_twin.parts.induction_motor import MotorConstants, motor_torque
from mech_twin.parts.supply import limited_command
from mech_twin.quantity import Parameters, choice, quantity
from mech_twin.samples import LinkageSample, MotorSample


class Coupling(Parameters):
    """How the roles exchange samples."""

    step_s: float = quantity("s", "coupling step: the roles exchange samples once per step", gt=0.0, le=1.0)


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


class Gear(Parameters):
    """Gear between motor and crank."""

    ratio: float = quantity("1", "motor speed over crank speed", gt=0.0)
    efficiency: float = quantity("1", "share of the motor's power that reaches the crank", gt=0.0, le=1.0)


@dataclass(frozen=True)
class PrescribedSpeed:
    """Motor that gives its first driven joint a speed, whatever effort that takes.

    ``speed`` is the speed at full command in the unit of the driven joint; ``driven`` is that joint's place in the
    linkage sample.
    """

    speed: float
    rate_per_s: float
    step_s: float
    driven: int = 0
    joints: tuple[str, ...] = ("motor",)

    def respond(self, linkage: LinkageSample, target: float) -> MotorSample:
        """Return the speed asked of the linkage at the end of the step, and the effort it takes now."""
        command = limited_command(linkage.command, target, self.rate_per_s, self.step_s)
        return MotorSample(
            linkage.step,
            linkage.time_s,
            self.joints,
            (linkage.position[self.driven],),
            (command * self.speed,),
            (linkage.effort[self.driven],),
            command,
        )


@dataclass(frozen=True)
class GearedMotor:
    """Induction motor whose torque follows from its speed, behind a gear."""

    motor: MotorConstants
    ratio: float
    rate_per_s: float
    step_s: float
    joints: tuple[str, ...] = ("motor",)

    def respond(self, linkage: LinkageSample, target: float) -> MotorSample:
        """Return rotor angle, rotor speed and shaft torque at the linkage's step."""
        command = limited_command(linkage.command, target, self.rate_per_s, self.step_s)
        speed = self.ratio * linkage.velocity[0]
        return MotorSample(
            linkage.step,
            linkage.time_s,
            self.joints,
            (self.ratio * linkage.position[0],),
            (speed,),
            (motor_torque(self.motor, speed, command),),
            command,
        )
