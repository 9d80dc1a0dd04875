"""Force analysis of the vibration crank: every pin force and the force on the frame, from the linkage's sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mech_twin.engine.crank_state import Memory
from mech_twin.machines.vibration_crank.slider_crank import SliderCrank, drive_moment, pin_forces, reduced
from mech_twin.samples import ForceSample, LinkageSample, Named, Wrench

QUANTITIES = (
    "reduced_inertia_kg_m2",
    "reduced_inertia_slope_kg_m2_per_rad",
    "reduced_moment_nm",
    "crank_acceleration_rad_per_s2",
    "drive_torque_nm",
    "drive_torque_without_counterweight_nm",
    "drive_power_w",
    "shaking_force_x_n",
    "shaking_force_y_n",
    "shaking_force_n",
)


@dataclass(frozen=True)
class SliderCrankForces:
    """Every pin force from equilibrium of follower, rod and crank."""

    mechanism: SliderCrank
    moment_scale: float
    pins: tuple[str, ...]
    acts_on: tuple[str, ...]

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limit of the residual: the two routes to the drive torque, over the peak torque."""
        return {"drive_torque_routes": 1e-10}

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return the pin forces at the angle, rate and acceleration of the crank, and its torque by both routes."""
        s = self.mechanism
        th, w, torque = linkage.joint("crank")
        inertia, slope, load = reduced(s, th)
        memory = Memory(*linkage.memory.values)
        e = memory.crank_acceleration_rad_per_s2
        at = pin_forces(s, th, w, e)
        size = (at.frame_x * at.frame_x + at.frame_y * at.frame_y) ** 0.5
        values = (
            inertia,
            slope,
            load,
            e,
            torque,
            drive_moment(s._replace(counter_mass=0.0), th, w, e),
            torque * w,
            at.frame_x,
            at.frame_y,
            size,
        )
        scale = max(self.moment_scale, abs(torque), inertia * abs(e), 1e-9)
        wrenches = (
            Wrench(at.bearing_x, at.bearing_y, 0.0),
            Wrench(at.pin_x, at.pin_y, 0.0),
            Wrench(at.pin_x, at.pin_y, 0.0),
            Wrench(at.ground_x, at.ground_y, at.ground_moment),
        )
        return ForceSample(
            linkage.step,
            linkage.time_s,
            self.pins,
            wrenches,
            Named(QUANTITIES, values),
            0.0,
            Named(("drive_torque_routes",), ((at.moment - torque - memory.friction_torque_nm) / scale,)),
        )
