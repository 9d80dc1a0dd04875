"""Force analysis of the press: every pin force, gains and reduced quantities, from the linkage's sample alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mech_twin.engine.crank_state import Memory
from mech_twin.machines.compaction_press.cycle import gains
from mech_twin.machines.compaction_press.dynamics import Press, press_pins, press_reduced, with_load_share
from mech_twin.parts.four_bar import acute_angles, coefficients, motion, position
from mech_twin.samples import ForceSample, LinkageSample, Named, Wrench

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


@dataclass(frozen=True)
class PressForces:
    """Every pin force from one equilibrium of the dyad, then the crank; pins named as in every four-bar."""

    press: Press
    moment_scale: float
    pins: tuple[str, ...] = ("crank_bearing", "crank_pin", "rocker_pin", "rocker_bearing")
    acts_on: tuple[str, ...] = ("crank", "plate", "plate", "pendulum")

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limit of the residual: the two routes to the drive torque, over the peak torque."""
        return {"drive_torque_routes": 1e-10}

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return the pin forces at the angle, rate and acceleration of the crank, and its torque by both routes."""
        memory = Memory(*linkage.memory.values)
        press = with_load_share(self.press, memory.load_share)
        f, w, torque = linkage.joint("crank")
        now = press_reduced(press, f, linkage.regime)
        e = memory.crank_acceleration_rad_per_s2
        at = position(press.bar, f)
        by = motion(press.bar, press.crank, press.plate, press.pendulum, at, coefficients(at), w, e)
        pins = press_pins(press, f, w, e, now.force)
        k1, k2, normal, vertical = gains(press, f)
        values = (
            *acute_angles(at),
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
            k1 * k2,
            normal,
            vertical,
            -pins.o_x - pins.c_x,
            -pins.o_y - pins.c_y,
        )
        wrenches = (
            Wrench(pins.o_x, pins.o_y, 0.0),
            Wrench(pins.a_x, pins.a_y, 0.0),
            Wrench(pins.b_x, pins.b_y, 0.0),
            Wrench(pins.c_x, pins.c_y, 0.0),
        )
        scale = max(self.moment_scale, abs(torque), now.inertia * abs(e), 1e-9)
        return ForceSample(
            linkage.step,
            linkage.time_s,
            self.pins,
            wrenches,
            Named(QUANTITIES, values),
            0.0,
            Named(("drive_torque_routes",), ((pins.moment - torque - memory.friction_torque_nm) / scale,)),
        )
