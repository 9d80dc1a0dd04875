"""Force analysis of the roller former: rods, guides, coupling and frame, from angles, rates and efforts of the joints.

The mass of a rod is halved to its ends (the page's model), so pin forces are those on crank and cart with their
half of the rod.  Guide friction in the drive's equation is that of the static load; what the inertia of a cart adds to
the guide reactions is shown in them and its friction neglected, as in (40).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel
from mech_twin.machines.roller_former.cart_parameters import MASS, OFFSET, REVERSING
from mech_twin.machines.roller_former.cart_statics import cart_motion, guide_reactions, rod_force
from mech_twin.machines.roller_former.dynamics import Former
from mech_twin.machines.roller_former.roles import CART_JOINTS, CRANK_JOINT, DRIVE_JOINT, TWIST_JOINT
from mech_twin.samples import ForceSample, LinkageSample, Named, Wrench

QUANTITIES = (
    "motor_moment_nm",
    "coupling_moment_nm",
    "elastic_moment_nm",
    "coupling_moment_at_motor_nm",
    "load_moment_nm",
    "inertia_moment_nm",
    "reduced_inertia_kg_m2",
    "crank_acceleration_rad_per_s2",
    "twist_acceleration_rad_per_s2",
    "shaking_force_x_n",
    "shaking_force_y_n",
    "drive_power_w",
    "load_power_w",
)
ROD_FORCE, FRONT, REAR, PIN_X, PIN_Y = range(5)


def pin_names(count: int) -> tuple[str, ...]:
    """Return the pins: shaft, then crank pin, cart pin, front and rear guide rollers of each cart."""
    kinds = ("crank_pin", "cart_pin", "guide_front", "guide_rear")
    return ("shaft", *(f"{kind}_{i}" for i in range(1, count + 1) for kind in kinds))


def loaded_bodies(count: int) -> tuple[str, ...]:
    """Return on which body each pin's force acts."""
    return ("shaft", *(body for i in range(1, count + 1) for body in (f"crank_{i}", *(f"cart_{i}",) * 3)))


@kernel
def load_sums(former: Former, crank: float, pulls: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return J_p2, half its derivative, and the load moment of the forces on the carts (N, along x)."""
    bank = former.bank
    inertia, slope, load = bank.crank_inertia_kg_m2, 0.0, 0.0
    for cart in range(pulls.size):
        sine, cosine = np.sin(crank + bank.carts[cart, OFFSET]), np.cos(crank + bank.carts[cart, OFFSET])
        motion = cart_motion(bank, sine, cosine)
        inertia += bank.carts[cart, MASS] * motion.x1 * motion.x1
        slope += bank.carts[cart, MASS] * motion.x1 * motion.x2
        load += pulls[cart] / motion.rod_cosine * bank.crank_m * sine * (motion.rod_cosine + bank.ratio * cosine)
    return inertia, slope, load


@kernel
def cart_forces(
    former: Former,
    crank: float,
    speed: float,
    acceleration: float,
    pulls: NDArray[np.float64],
    rows: NDArray[np.float64],
) -> tuple[float, float, float, float, float]:
    """Fill ``rows`` with rod force, guide reactions and rod pull on the crank pin (N) of each cart.

    Returns the moment about the shaft by the crank pins (N m), the force on the shaft and the shaking force (N).
    """
    bank = former.bank
    moment, shaft_x, shaft_y, shake_x, shake_y = 0.0, 0.0, 0.0, 0.0, 0.0
    for cart in range(pulls.size):
        mass = bank.carts[cart, MASS]
        half = bank.rod_half_kg if mass > 0.0 else 0.0
        psi = crank + bank.carts[cart, OFFSET]
        sine, cosine = np.sin(psi), np.cos(psi)
        motion = cart_motion(bank, sine, cosine)
        inertia_x = mass * (motion.x1 * acceleration + motion.x2 * speed * speed)
        force = (pulls[cart] - inertia_x) / motion.rod_cosine
        sense = -1.0 if bank.load == REVERSING and pulls[cart] < 0.0 else 1.0
        static = rod_force(bank, cart, motion.rod_sine, motion.rod_cosine, sense) * motion.rod_cosine
        share = min(abs(pulls[cart] / static), 1.0) if static != 0.0 else 0.0
        rows[cart, ROD_FORCE] = force
        rows[cart, FRONT], rows[cart, REAR] = guide_reactions(bank, cart, motion.rod_sine, force, sense, share)
        pin_x, pin_y = force * motion.rod_cosine, -force * motion.rod_sine
        rows[cart, PIN_X], rows[cart, PIN_Y] = pin_x, pin_y
        moment += bank.crank_m * (cosine * pin_y - sine * pin_x)
        end_x = half * bank.crank_m * (-sine * acceleration - cosine * speed * speed)
        end_y = half * bank.crank_m * (cosine * acceleration - sine * speed * speed)
        shaft_x += pin_x - end_x
        shaft_y += pin_y - end_y
        shake_x -= inertia_x + end_x
        shake_y -= end_y
    return moment, shaft_x, shaft_y, shake_x, shake_y


@kernel
def force_rows(
    former: Former, joints: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[float, float, float]]:
    """Return per-cart rows, the quantities, and shaft force and residual, from joints (3, n): angle, rate, effort."""
    crank, speed = joints[0, CRANK_JOINT], joints[1, CRANK_JOINT]
    motor, transmitted, elastic = joints[2, DRIVE_JOINT], joints[2, CRANK_JOINT], joints[2, TWIST_JOINT]
    pulls = joints[2, CART_JOINTS::2].copy()
    inertia, slope, load = load_sums(former, crank, pulls)
    acceleration = (transmitted - load - speed * speed * slope) / inertia
    rows = np.empty((pulls.size, 5))
    moment, shaft_x, shaft_y, shake_x, shake_y = cart_forces(former, crank, speed, acceleration, pulls, rows)
    residual = transmitted + moment - former.bank.crank_inertia_kg_m2 * acceleration
    scale = former.motor.breakdown_torque_nm * former.ratio + abs(transmitted) + abs(load)
    quantities = np.array(
        [
            motor,
            transmitted,
            elastic,
            transmitted / former.ratio,
            load,
            inertia * acceleration + speed * speed * slope,
            inertia,
            acceleration,
            (motor - transmitted) / former.motor_inertia_kg_m2 - acceleration,
            shake_x,
            shake_y,
            motor * joints[1, DRIVE_JOINT],
            load * speed,
        ]
    )
    return rows, quantities, (shaft_x, shaft_y, residual / scale)


@dataclass(frozen=True)
class FormerForces:
    """Rod forces, guide reactions, coupling moment and shaking force; a map without state."""

    former: Former
    pins: tuple[str, ...]
    acts_on: tuple[str, ...]
    names: tuple[str, ...]

    @property
    def residual_limits(self) -> dict[str, float]:
        """Limit of the two routes; the expansion's transfer function is not the linkage's, to the order (r/l)^3."""
        ratio = self.former.bank.ratio
        return {"drive_torque_routes": 2.0 * ratio**3 if self.former.bank.expanded else 1e-10}

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return every force at the linkage's step.

        The two routes to the moment in the coupling: the reduced equation of motion, and the crank-pin forces' moments.
        """
        joints = np.array([linkage.position, linkage.velocity, linkage.effort])
        rows, quantities, (shaft_x, shaft_y, residual) = force_rows(self.former, joints)
        wrenches = [Wrench(-shaft_x, -shaft_y, float(quantities[1]))]
        for _, front, rear, pin_x, pin_y in rows.tolist():
            wrenches.append(Wrench(pin_x, pin_y, 0.0))
            wrenches.append(Wrench(-pin_x, -pin_y, 0.0))
            wrenches.append(Wrench(0.0, -front, 0.0))
            wrenches.append(Wrench(0.0, -rear, 0.0))
        values = (*quantities.tolist(), *rows[:, ROD_FORCE].tolist())
        return ForceSample(
            linkage.step,
            linkage.time_s,
            self.pins,
            tuple(wrenches),
            Named(self.names, values),
            0.0,
            Named(("drive_torque_routes",), (residual,)),
        )
