"""Parameters of the roller former, and the constants its kernels need."""

from __future__ import annotations

from math import inf, sqrt
from typing import Any, Literal

from pydantic import model_validator

from mech_twin.machines.roller_former.cart_parameters import (
    CartBank,
    CartParameters,
    GuideFriction,
    Kinematics,
    LoadKind,
    cart_bank,
)
from mech_twin.machines.roller_former.dynamics import Former
from mech_twin.machines.roller_former.elastic_drive import DriveParameters, reduced_inertia
from mech_twin.parts.induction_motor import InductionMotorParameters, motor_constants
from mech_twin.parts.supply import SupplyParameters
from mech_twin.quantity import Parameters, choice, quantity

SET_KEYS = ("mass_kg", "roller_force_x_n", "roller_force_y_n", "weight_n")


class LoadSet(Parameters):
    """Mass and loads of a cart that belong together."""

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

    crank_deg: float = quantity("deg", "crank angle at the start")
    speed_fraction: float = quantity("1", "crank speed at the start over synchronous speed", ge=0.0, le=1.0)
    load_from_fraction: float = quantity(
        "1", "crank speed over synchronous speed at which the load comes on; 0 starts under load", ge=0.0, lt=1.0
    )
    load_rise_s: float = quantity("s", "time in which the load then rises to its full size", ge=0.0)


class StallParameters(Parameters):
    """When a motor that is supplied counts as stalled."""

    speed_fraction: float = quantity("1", "motor speed over commanded synchronous speed", gt=0.0, lt=1.0)
    time_s: float = quantity("s", "time below that speed", gt=0.0)


class IntegratorParameters(Parameters):
    """Error control of the integration."""

    tolerance: float = quantity("1", "error per step over the scale of each coordinate", gt=1e-14, le=1e-4)


class FormerCoupling(Parameters):
    """How the roles exchange samples."""

    step_s: float = quantity("s", "coupling step: the roles exchange samples once per step", gt=0.0, le=0.01)


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
    coupling: FormerCoupling = choice("coupling of the roles")

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

    @property
    def rated_crank_speed_rad_per_s(self) -> float:
        """Crank speed at the motor's rated point (rad/s)."""
        return motor_constants(self.motor).rated_speed_rad_per_s / self.drive.ratio

    @property
    def synchronous_crank_speed_rad_per_s(self) -> float:
        """Crank speed at the motor's synchronous speed (rad/s)."""
        return motor_constants(self.motor).synchronous_speed_rad_per_s / self.drive.ratio


def bank_of(parameters: RollerFormer) -> CartBank:
    """Return the carts as the kernels want them."""
    return cart_bank(parameters.carts, parameters.load, parameters.guide_friction, parameters.kinematics)


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
    return Former(
        bank=bank_of(p),
        motor=motor,
        motor_inertia_kg_m2=inertia,
        stiffness_nm_per_rad=p.drive.stiffness_nm_per_rad,
        damping_nms_per_rad=p.drive.damping_nms_per_rad,
        ratio=p.drive.ratio,
        efficiency=p.drive.efficiency,
        engage_speed_rad_per_s=p.start.load_from_fraction * speed if p.start.load_from_fraction > 0.0 else -inf,
        load_rise_s=p.start.load_rise_s,
        slow_speed_rad_per_s=p.stall.speed_fraction * speed,
        stall_time_s=p.stall.time_s,
        tolerance=p.integrator.tolerance,
        scales=(1.0, twist, speed, twist_rate, energy, energy, energy),
    )
