# SPDX-License-Identifier: Apache-2.0
r"""Parameters of the roller former, and the constants its kernels need.

The elastic drive between motor and crank shaft is reduced to the crank::

      motor      coupling    gearbox                   J_p1        c         J_p2
     [ J_r ]-----[ J_c ]-----[ u, eta ]----> crank   (phi1, w1)--/\/\--(phi2, w2)
                                                               --[ k ]--

Source: LoveikinRoller2018 eq. (1) and (40).
"""

from __future__ import annotations

from math import hypot, inf, sqrt
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator, model_validator

from mech_twin.declarations.quantity import Parameters, choice, quantity, upper
from mech_twin.engine.coupling import Coupling
from mech_twin.machines.drives import MOST_STIFFNESS
from mech_twin.machines.roller_former.cart_parameters import (
    CartBank,
    CartParameters,
    GuideFriction,
    Kinematics,
    LoadKind,
    cart_bank,
    check_guides,
    inertia_range_kg_m2,
)
from mech_twin.machines.roller_former.dynamics import Former, FormerState
from mech_twin.parts.friction_and_gear import Friction, Gear
from mech_twin.parts.induction_motor import InductionMotorParameters, SupplyParameters, motor_constants

SET_KEYS = ("mass_kg", "roller_force_x_n", "roller_force_y_n", "weight_n")
LARGEST_EXPANDED_RATIO = 0.5  # of crank to rod
LONGEST_STEP_S = 0.01
SHORTEST_RISE_S = 1e-3  # of the load: a faster one is a load that is there at once
SMALLEST_INERTIA = 1e-6  # of crank shaft and carts over that of the motor's side
LARGEST_STORED = 1e6  # energy of crank shaft, carts and weights over twice that of the motor's side
HEAVY = 10.0  # the same ratio, above which the crank is followed more exactly
BALANCED = 1e-10  # of twice the motor side's energy: what a step may then miss of the crank's
FINEST = 1e-15  # of a coordinate's scale: what double precision has
LARGEST_RATE_PER_S = 1e6  # of anything that decays or swings: the integration is explicit


class DriveParameters(Gear):
    """Gearbox, coupling, and the stiffness and damping of the drive at the crank."""

    ratio: float = quantity("1", "motor speed over crank speed, u", ge=0.1, le=1000.0)
    gear_loss: Literal["power", "printed"] = choice(
        "power: u eta M while the motor drives, u M/eta while it is driven; printed: u eta M always, as (40)",
        default="power",
    )
    inertia_factor: float = quantity("1", "gearbox parts counted in with the motor shaft, delta", ge=1.0, le=10.0)
    coupling_inertia_kg_m2: float = quantity("kg m^2", "inertia of the coupling on the motor shaft", ge=0.0, le=1e4)
    coupling_rated_moment_nm: float = quantity("N m", "rated moment of the coupling, on the motor shaft", gt=0.0)
    stiffness_nm_per_rad: float = quantity(
        "N m/rad", "stiffness c of the drive at the crank", ge=1.0, le=1e10, live=True
    )
    damping_nms_per_rad: float = quantity("N m s/rad", "damping k of the drive at the crank", ge=0.0, le=1e8, live=True)


def reduced_inertia(drive: DriveParameters, rotor_inertia_kg_m2: float) -> float:
    """Return ``J_p1 = (J_rotor + J_coupling) delta u^2`` (kg m^2), eq. (1)."""
    return (rotor_inertia_kg_m2 + drive.coupling_inertia_kg_m2) * drive.inertia_factor * drive.ratio**2


class LoadSet(Parameters):
    """Mass and loads of a cart that form one set of the source."""

    mass_kg: float = quantity("kg", "mass of a cart without its half of the rod", ge=0.0)
    roller_force_x_n: float = quantity("N", "horizontal force of one roller on the mix", ge=0.0)
    roller_force_y_n: float = quantity("N", "vertical force of the mix on one roller", ge=0.0)
    weight_n: float = quantity("N", "weight of a cart with its half of the rod", ge=0.0)


class LoadSets(Parameters):
    """The two sets of the source."""

    table: LoadSet = choice("the set the paper's tables were computed with")
    printed: LoadSet = choice("the set the paper prints")


class StartParameters(Parameters):
    """How the machine starts, and when the load comes on."""

    crank_deg: float = quantity("deg", "crank angle at the start", ge=-3600.0, le=3600.0)
    speed_fraction: float = quantity("1", "crank speed at the start over synchronous speed", ge=0.0, le=1.0)
    load_from_fraction: float = quantity(
        "1", "crank speed over synchronous speed at which the load comes on; 0 starts under load", ge=0.0, lt=1.0
    )
    load_rise_s: float = quantity("s", "time in which the load then rises to its full size", ge=0.0, le=3600.0)

    @field_validator("load_rise_s")
    @classmethod
    def _long_enough(cls, value: float) -> float:
        if 0.0 < value < SHORTEST_RISE_S:
            raise ValueError(f"0 (at once) or at least {SHORTEST_RISE_S:g} s needed, got {value:g}")
        return value


class StallParameters(Parameters):
    """When a motor that is supplied counts as stalled."""

    speed_fraction: float = quantity("1", "motor speed over commanded synchronous speed", ge=1e-6, lt=1.0)
    time_s: float = quantity("s", "time below that speed", ge=1e-6, le=3600.0)


class IntegratorParameters(Parameters):
    """Error control of the integration."""

    tolerance: float = quantity("1", "error per step over the scale of each coordinate", ge=1e-13, le=1e-7)


class RollerFormer(Parameters):
    """Parameters of the roller former."""

    parameter_set: Literal["table", "printed"] = choice("which load set fills the carts' mass and loads")
    load_sets: LoadSets = choice("mass and loads of a cart, both sets of the source")
    carts: CartParameters = choice("carts; mass_kg, roller forces and weight_n come from the set unless given here")
    load: LoadKind = choice("how the load acts on the shaft")
    guide_friction: GuideFriction = choice("friction on signed guide reactions, as printed, or on their size")
    kinematics: Kinematics = choice("exact, or the paper's expansion")
    motor: InductionMotorParameters = choice("motor")
    drive: DriveParameters = choice("gearbox, coupling, stiffness and damping")
    supply: SupplyParameters = choice("supply of the motor")
    start: StartParameters = choice("start")
    stall: StallParameters = choice("stall")
    integrator: IntegratorParameters = choice("integration")
    coupling: Coupling = choice("coupling of the roles")
    friction: Friction = choice("friction of the crank shaft", default=Friction())

    @model_validator(mode="before")
    @classmethod
    def _set_fills_the_carts(cls, tree: Any) -> Any:
        """Fill the carts' mass and loads from the named set where they are absent, or wholly those of the other set."""
        try:
            sets, name, carts = tree["load_sets"], tree["parameter_set"], dict(tree["carts"])
            named = sets[name]
            other = sets["printed" if name == "table" else "table"]
            left_over = all(carts.get(key) == other[key] for key in SET_KEYS)
            values = {key: named[key] for key in SET_KEYS}
        except (KeyError, TypeError, ValueError):
            return tree  # incomplete or misshapen: the fields themselves say what is wrong
        carts = {**carts, **values} if left_over else {**values, **carts}
        return {**tree, "carts": carts}

    @model_validator(mode="after")
    def _can_be_integrated(self) -> RollerFormer:
        """Raise for self-locking guides, a shaft without inertia, a too stiff drive, a step too long for the motor."""
        check_guides(self.carts, self.load, self.guide_friction)
        ratio = self.carts.crank_m / self.carts.rod_m
        if self.kinematics == "expanded" and ratio > LARGEST_EXPANDED_RATIO:
            raise ValueError(
                f"kinematics: expanded needs crank_m <= {LARGEST_EXPANDED_RATIO} rod_m, got {ratio:.4g}: the expansion "
                "leaves the third power of the ratio out; exact has no such limit"
            )
        first = reduced_inertia(self.drive, self.motor.rotor_inertia_kg_m2)
        bank = bank_of(self)
        least, _most = inertia_range_kg_m2(bank)
        if least < SMALLEST_INERTIA * first:
            raise ValueError(
                f"carts: crank shaft and carts have a reduced inertia of {least:.3g} kg m^2 at a dead centre, at "
                f"least {SMALLEST_INERTIA * first:.3g} is needed: rod_mass_kg or crank_inertia_kg_m2 must be larger"
            )
        speed = self.synchronous_crank_speed_rad_per_s
        stored = crank_energy_j(bank, speed)
        scale = LARGEST_STORED * first * speed**2
        if stored > scale:
            raise ValueError(
                f"carts: crank shaft, carts and weights hold up to {stored:.3g} J at synchronous speed, at most "
                f"{scale:.3g} J, {LARGEST_STORED:g} times what the motor's side holds, is needed, or the balance of "
                "energy is lost in rounding: rod_mass_kg, mass_kg or crank_inertia_kg_m2 must be smaller"
            )
        both = 1.0 / first + 1.0 / least
        for key, rate in (
            ("damping_nms_per_rad", self.drive.damping_nms_per_rad * both),
            ("stiffness_nm_per_rad", sqrt(self.drive.stiffness_nm_per_rad * both)),
            ("friction.viscous_nms_per_rad", self.friction.viscous_nms_per_rad / least),
        ):
            if rate > LARGEST_RATE_PER_S:
                raise ValueError(
                    f"{key}: with the least inertia of the shaft, {least:.3g} kg m^2, it makes a rate of "
                    f"{rate:.3g} 1/s; at most {LARGEST_RATE_PER_S:g} is needed"
                )
        longest = longest_step_s(self)
        if self.coupling.step_s > longest:
            raise ValueError(
                f"coupling.step_s <= {upper(longest, 3)} s needed, got {self.coupling.step_s:g}: at most "
                f"{MOST_STIFFNESS:g} times the time constant of the motor's inertia and torque curve"
            )
        return self

    @property
    def rated_crank_speed_rad_per_s(self) -> float:
        """Crank speed at the motor's rated point (rad/s)."""
        return motor_constants(self.motor).rated_speed_rad_per_s / self.drive.ratio

    @property
    def synchronous_crank_speed_rad_per_s(self) -> float:
        """Crank speed at the motor's synchronous speed (rad/s)."""
        return motor_constants(self.motor).synchronous_speed_rad_per_s / self.drive.ratio


def longest_step_s(parameters: RollerFormer) -> float:
    """Return the longest coupling step (s): `MOST_STIFFNESS` ``J_p1/(u^2 max|dM/dw|)``, and at most 10 ms.

    The steepest place of the curve is at slip 0, ``2 M_kr/(s_kr w_0)``; the correction for starting is flatter; eta is
    at its worst.
    """
    p, motor = parameters, motor_constants(parameters.motor)
    steepest = 2.0 * motor.breakdown_torque_nm / (motor.breakdown_slip * motor.synchronous_speed_rad_per_s)
    worst = 1.0 / p.drive.efficiency if p.drive.gear_loss == "power" else p.drive.efficiency
    inertia = (p.motor.rotor_inertia_kg_m2 + p.drive.coupling_inertia_kg_m2) * p.drive.inertia_factor
    return min(LONGEST_STEP_S, MOST_STIFFNESS * inertia / (steepest * worst))


def bank_of(parameters: RollerFormer) -> CartBank:
    """Return the kernel constants of the carts."""
    return cart_bank(parameters.carts, parameters.load, parameters.guide_friction, parameters.kinematics)


def crank_energy_j(bank: CartBank, speed_rad_per_s: float) -> float:
    """Return the largest energy (J) of crank shaft, carts and weights over a turn at a crank speed (rad/s)."""
    _least, most = inertia_range_kg_m2(bank)
    return 0.5 * most * speed_rad_per_s**2 + hypot(bank.rod_weight_cosine_nm, bank.rod_weight_sine_nm)


def tolerances_of(tolerance: float, scales: FormerState, crank_j: float) -> NDArray[np.float64]:
    """Return the error tolerances of a step, shape (8,).

    The energy balance is relative to the energy of the motor's side.  If the crank's energy ``crank_j`` (J) is many
    times that, its angle and speed are integrated more exactly, to a hundredth of the balance's limit in a step.
    A soft coupling would twist by thousands of turns under the rated moment, which is no scale of an error: the scales
    are at most a radian and synchronous speed.
    """
    own_j, crank = scales.motor_work_j, tolerance
    scales = scales._replace(
        twist_rad=min(scales.twist_rad, scales.crank_rad),
        twist_rate_rad_per_s=min(scales.twist_rate_rad_per_s, scales.crank_speed_rad_per_s),
    )
    if crank_j > HEAVY * own_j:
        crank = min(tolerance, max(BALANCED * own_j / crank_j, FINEST))
    exact = FormerState(crank, tolerance, crank, tolerance, tolerance, tolerance, tolerance, tolerance)
    errors: NDArray[np.float64] = np.array(exact) * np.array(scales)
    return errors


def former_of(parameters: RollerFormer) -> Former:
    """Return all constants of the motion.

    The scales of error control: 1 rad of crank; twist and twist rate of the rated moment; synchronous speed; kinetic
    energy of the motor side.
    """
    p = parameters
    motor = motor_constants(p.motor)
    inertia = reduced_inertia(p.drive, p.motor.rotor_inertia_kg_m2)
    speed = p.synchronous_crank_speed_rad_per_s
    twist = motor.rated_torque_nm * p.drive.ratio / p.drive.stiffness_nm_per_rad
    twist_rate = 3.0 * twist * sqrt(p.drive.stiffness_nm_per_rad / inertia)
    energy = inertia * speed * speed
    scales = FormerState(1.0, twist, speed, twist_rate, energy, energy, energy, energy)
    bank = bank_of(p)
    crank_j = crank_energy_j(bank, speed)
    return Former(
        bank=bank,
        motor=motor,
        motor_inertia_kg_m2=inertia,
        stiffness_nm_per_rad=p.drive.stiffness_nm_per_rad,
        damping_nms_per_rad=p.drive.damping_nms_per_rad,
        ratio=p.drive.ratio,
        efficiency=p.drive.efficiency,
        loss_by_power=p.drive.gear_loss == "power",
        coulomb_nm=p.friction.coulomb_nm,
        viscous_nms_per_rad=p.friction.viscous_nms_per_rad,
        engage_speed_rad_per_s=p.start.load_from_fraction * speed if p.start.load_from_fraction > 0.0 else -inf,
        load_rise_s=p.start.load_rise_s,
        slow_speed_rad_per_s=p.stall.speed_fraction * speed,
        stall_time_s=p.stall.time_s,
        scales=scales,
        tolerances=tolerances_of(p.integrator.tolerance, scales, crank_j),
    )
