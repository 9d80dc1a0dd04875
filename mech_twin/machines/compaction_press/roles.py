# SPDX-License-Identifier: Apache-2.0
"""Linkage of the press (its regimes, the layer's boundaries along the turn) and its force analysis.

The forces (every pin, gains, reduced quantities) follow from the linkage's sample alone.
"""

from math import nan
from typing import NamedTuple

from mech_twin.engine.compiled_steps import Work, force_step, step_of
from mech_twin.engine.crank_linkage import FORCE_RESIDUALS, CrankLinkage, route_miss
from mech_twin.engine.crank_state import NO_FRICTION, Boundary, Resisting, ShaftFriction, Transmission, memory_of
from mech_twin.engine.sample_vectors import LINKAGE_JOINTS, REGIME, Array, ForceLayout
from mech_twin.kernels.kernel import borrowing_kernel
from mech_twin.machines.compaction_press.cycle import gains, regime_at
from mech_twin.machines.compaction_press.dynamics import (
    COMPACTED,
    COMPACTED_REVERSED,
    CONTACT,
    CONTACT_REVERSED,
    FREE,
    Press,
    press_pins,
    press_reduced,
    with_load_share,
)
from mech_twin.machines.compaction_press.parameters import Stroke
from mech_twin.parts.four_bar import acute_angles, coefficients, motion, position

QUANTITIES = (
    "alpha_rad",
    "beta_rad",
    "gamma_rad",
    "plate_acceleration_rad_per_s2",
    "pendulum_acceleration_rad_per_s2",
    "crank_acceleration_rad_per_s2",
    "reduced_inertia_kg_m2",
    "reduced_inertia_slope_kg_m2_per_rad",
    "reduced_moment_nm",
    "drive_torque_nm",
    "drive_power_w",
    "working_force_n",
    "loaded_point_height_m",
    "loaded_point_speed_m_per_s",
    "gain_k1",
    "gain_k2",
    "gain_paper",
    "gain_normal",
    "gain_vertical",
    "shaking_force_x_n",
    "shaking_force_y_n",
)

LARGEST_GAIN = 1e300  # of the paper's gain, which has no limit where the pendulum's end is at rest
REGIMES = ("free", "contact", "contact_reversed", "compacted", "compacted_reversed")
SET_LAYER = {CONTACT: Resisting(1.0, COMPACTED), CONTACT_REVERSED: Resisting(-1.0, COMPACTED_REVERSED)}


class LoadedPress(NamedTuple):
    """Constants of the force analysis: the press, and the largest drive torque of a cycle (N m)."""

    press: Press
    moment_scale_nm: float


@step_of(force_step, LoadedPress, borrowing_kernel)
def press_forces(
    model: LoadedPress, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill ``out`` with the pin forces at the crank's angle, rate and acceleration, and its torque by both routes."""
    memory = memory_of(linkage, 3)
    press = with_load_share(model.press, memory.load_share)
    f, w, torque = linkage[LINKAGE_JOINTS], linkage[LINKAGE_JOINTS + 1], linkage[LINKAGE_JOINTS + 2]
    now = press_reduced(press, f, int(linkage[REGIME]))
    e = memory.crank_acceleration_rad_per_s2
    at = position(press.bar, f)
    by = motion(press.bar, press.crank, press.plate, press.pendulum, at, coefficients(at), w, e)
    pins = press_pins(press, f, w, e, now.force)
    k1, k2, normal, vertical = gains(press, f)
    alpha, beta, gamma = acute_angles(at)
    numbers = (
        0.0,
        pins.o_x, pins.o_y, 0.0,
        pins.a_x, pins.a_y, 0.0,
        pins.b_x, pins.b_y, 0.0,
        pins.c_x, pins.c_y, 0.0,
        alpha,
        beta,
        gamma,
        by.e2,
        by.e3,
        e,
        now.inertia,
        now.slope,
        now.moment,
        torque,
        torque * w,
        now.force,
        now.y,
        now.y1 * w,
        k1,
        k2,
        min(k1 * k2, LARGEST_GAIN),
        normal,
        vertical,
        -pins.o_x - pins.c_x,
        -pins.o_y - pins.c_y,
    )  # fmt: skip
    for i in range(len(numbers)):
        out[i] = numbers[i]
    out[len(numbers)] = route_miss(pins.moment, torque, now.inertia, memory, model.moment_scale_nm)
    return 0


# every pin force from one equilibrium of the dyad, then the crank; pins named as in every four-bar
FORCES = ForceLayout(("crank_bearing", "crank_pin", "rocker_pin", "rocker_bearing"), QUANTITIES, FORCE_RESIDUALS)
ACTS_ON = ("crank", "plate", "plate", "pendulum")


def press_boundaries(stroke: Stroke, first: str, gives_back: bool = True) -> tuple[Boundary, ...]:
    """Return the boundaries of contact with the layer: first contact (event ``first``), bottom, release, new contact.

    A layer without spring-back is in contact again where the crank reversed, and is a new one after the top.
    """
    pressed = (
        Boundary(stroke.contact, 1.0, FREE, CONTACT, first),
        Boundary(stroke.bottom, 1.0, CONTACT, FREE, "bottom"),
        Boundary(stroke.contact_reversed, -1.0, FREE, CONTACT_REVERSED, first),
        Boundary(stroke.bottom, -1.0, CONTACT_REVERSED, FREE, "bottom"),
    )
    if gives_back:
        return (
            *pressed,
            Boundary(stroke.contact, -1.0, CONTACT, FREE, "release"),
            Boundary(stroke.contact_reversed, 1.0, CONTACT_REVERSED, FREE, "release"),
        )
    return (
        *pressed,
        Boundary(nan, 1.0, COMPACTED, CONTACT, first),
        Boundary(stroke.top, -1.0, COMPACTED, FREE, "top"),
        Boundary(nan, -1.0, COMPACTED_REVERSED, CONTACT_REVERSED, first),
        Boundary(stroke.top, 1.0, COMPACTED_REVERSED, FREE, "top"),
    )


def press_linkage(
    press: Press,
    stroke: Stroke,
    step_s: float,
    speed: float,
    command: float,
    direction: float,
    first_contact: str,
    transmission: Transmission | None,
    friction: ShaftFriction = NO_FRICTION,
    gives_back: bool = True,
) -> CrankLinkage:
    """Return the linkage role: crank at angle 0 and this speed (rad/s), the layer's boundaries along its turn."""
    return CrankLinkage(
        press,
        step_s,
        0.0,
        speed,
        command,
        ("crank", "plate", "pendulum"),
        "plate",
        REGIMES,
        regime_at(stroke, 0.0, direction),
        press_boundaries(stroke, first_contact, gives_back),
        transmission,
        friction,
        size_m=press.bar.coupler_m + press.bar.rocker_m,
        resisting={} if gives_back else SET_LAYER,
    )
