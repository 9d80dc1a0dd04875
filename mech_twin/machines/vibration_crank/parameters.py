"""Parameters of the vibration crank, and the constants of its kernels."""

from __future__ import annotations

from math import hypot, isinf
from typing import Literal

from pydantic import model_validator

from mech_twin.engine.coupling import Coupling
from mech_twin.machines.drives import Drive
from mech_twin.machines.vibration_crank.counterweight import Counterweight, Masses, balance
from mech_twin.machines.vibration_crank.slider_crank import BOOM, FINITE_ROD, INFINITE_ROD, SliderCrank
from mech_twin.parts.friction import Friction
from mech_twin.parts.gear import Gear
from mech_twin.parts.induction_motor import InductionMotorParameters
from mech_twin.parts.supply import SupplyParameters
from mech_twin.quantity import Parameters, choice, quantity

GRAVITY = 9.80665


class Boom(Parameters):
    """Boom as a rocker: it carries the load beyond the joint of the rod."""

    pivot_x_m: float = quantity("m", "boom pivot, to the right of the crank bearing")
    pivot_y_m: float = quantity("m", "boom pivot, above the crank bearing")
    length_m: float = quantity("m", "boom from its pivot to the joint of the rod", gt=0.0)
    load_ratio: float = quantity("1", "arm of the load over the length to the joint", gt=0.0)
    side: Literal["left", "right"] = choice("on which side of the line from pivot to crank pin the joint lies")


class VibrationCrank(Parameters):
    """Parameters of the vibration crank."""

    masses: Masses = choice("masses of the parts")
    crank_m: float = quantity("m", "crank radius r", gt=0.0)
    rod_m: float = quantity("m", "rod length; infinite for pure harmonic motion", gt=0.0, allow_inf_nan=True)
    offset_m: float = quantity("m", "offset e of the slider's line from the crank bearing")
    slider: Literal["above", "below"] = choice("slider above or below the crank")
    working_force_n: float = quantity("N", "working force down on the follower")
    boom: Boom | None = choice("boom as a rocker; a slider where absent", default=None)
    counterweight: Counterweight = choice("counterweight on the crank")
    drive: Drive = choice("drive of the crank")
    motor: InductionMotorParameters | None = choice("motor of a kloss drive", default=None)
    gear: Gear | None = choice("gear of a kloss drive", default=None)
    supply: SupplyParameters = choice("supply of the drive")
    friction: Friction = choice("friction at the crank shaft", default=Friction())
    coupling: Coupling = choice("coupling of the roles")

    @model_validator(mode="after")
    def _crank_turns(self) -> VibrationCrank:
        if self.rod_m != self.rod_m:
            raise ValueError("rod_m must be a length or infinite, got nan")
        if self.boom is None:
            if self.rod_m <= self.crank_m + abs(self.offset_m):
                raise ValueError(
                    f"rod > crank + |offset| fails: {self.rod_m:g} m > {self.crank_m + abs(self.offset_m):g} m"
                )
            return self
        if isinf(self.rod_m):
            raise ValueError("rod_m must be finite where the boom is a rocker")
        ground = hypot(self.boom.pivot_x_m, self.boom.pivot_y_m)
        near, far = abs(ground - self.crank_m), ground + self.crank_m
        if far >= self.boom.length_m + self.rod_m:
            raise ValueError(f"pivot + crank < boom + rod fails: {far:g} m < {self.boom.length_m + self.rod_m:g} m")
        if near <= abs(self.boom.length_m - self.rod_m):
            raise ValueError(
                f"|pivot - crank| > |boom - rod| fails: {near:g} m > {abs(self.boom.length_m - self.rod_m):g} m"
            )
        return self

    @model_validator(mode="after")
    def _drive_complete(self) -> VibrationCrank:
        if self.drive.kind == "kloss" and (self.motor is None or self.gear is None):
            raise ValueError("a kloss drive needs both groups motor and gear")
        return self


def slider_crank_constants(parameters: VibrationCrank) -> SliderCrank:
    """Return the constants of the kernels."""
    p = parameters
    masses = balance(p.masses, p.counterweight, p.crank_m)
    kind = INFINITE_ROD if isinf(p.rod_m) else FINITE_ROD
    joint, load, arm = masses.reciprocating_kg, 0.0, (0.0, 0.0, 1.0, 1.0, 1.0)
    if p.boom is not None:
        kind, joint, load = BOOM, p.masses.at_rod_joint, p.masses.carried
        side = 1.0 if p.boom.side == "left" else -1.0
        arm = (p.boom.pivot_x_m, p.boom.pivot_y_m, p.boom.length_m, p.boom.load_ratio, side)
    return SliderCrank(
        kind,
        p.crank_m,
        0.0 if isinf(p.rod_m) else p.rod_m,
        p.offset_m,
        1.0 if p.slider == "above" else -1.0,
        *arm,
        joint,
        load,
        masses.rotating_kg,
        masses.counterweight_kg,
        p.counterweight.radius_m,
        p.working_force_n,
        GRAVITY,
    )
