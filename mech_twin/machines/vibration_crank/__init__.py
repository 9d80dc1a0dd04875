"""Crank vibration mechanism with counterweight: drive moment, pin forces and the force it leaves on the frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, sin
from typing import Any

from mech_twin.engine.crank_linkage import CrankKernels, CrankLinkage, Transmission
from mech_twin.machines.drives import KlossDrive, PrescribedSpeed
from mech_twin.machines.vibration_crank.dynamics import crank_state, driven_step, prescribed_step
from mech_twin.machines.vibration_crank.metrics import ShakerObserver, cycle_report, position_figures
from mech_twin.machines.vibration_crank.parameters import VibrationCrank, shaker_constants
from mech_twin.parts.induction_motor import motor_constants
from mech_twin.parts.slider_crank import BOOM, FINITE_ROD, Shaker, drive_moment, follower, reduced, shaker_forces
from mech_twin.quantity import Parameters
from mech_twin.roles import Capabilities, LinkageRole, Machine, MotorRole
from mech_twin.samples import ForceSample, LinkageSample, Named, Shape, Wrench

PARAMETERS = VibrationCrank
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
class ShakerForceAnalysis:
    """Every pin force from equilibrium; the acceleration is found from the crank torque by the reduced inertia."""

    shaker: Shaker
    moment_scale: float
    force_scale: float
    pins: tuple[str, ...]
    acts_on: tuple[str, ...]

    @property
    def residual_limits(self) -> Mapping[str, float]:
        """Limits of the running proofs."""
        return {"drive_torque_routes": 1e-10, "shaking_force_routes": 1e-10}

    def analyse(self, linkage: LinkageSample) -> ForceSample:
        """Return the pin forces at the joint angles, rates and crank torque of the sample."""
        s = self.shaker
        th, w, torque = linkage.position[0], linkage.velocity[0], linkage.effort[0]
        inertia, slope, load = reduced(s, th)
        e = (torque + load - 0.5 * w * w * slope) / inertia
        at = shaker_forces(s, th, w, e)
        size = (at.frame_x * at.frame_x + at.frame_y * at.frame_y) ** 0.5
        weights = (s.joint_mass + s.load_mass + s.rotating_mass + s.counter_mass) * s.gravity + s.working_force
        # what the frame gives, weights and working force taken off, is what it gets back turned round
        miss_x = at.bearing_x + at.ground_x + at.frame_x
        miss_y = at.bearing_y + at.ground_y + at.frame_y - weights
        scale = max(self.force_scale, size, weights)
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
        residuals = (
            (at.moment - torque) / max(self.moment_scale, abs(torque), inertia * abs(e)),
            (abs(miss_x) + abs(miss_y)) / scale,
        )
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
            Named(("drive_torque_routes", "shaking_force_routes"), residuals),
        )


def _drawing(s: Shaker, linkage: LinkageSample) -> tuple[Shape, ...]:
    th = linkage.position[0]
    at = follower(s, th)
    crank = (s.crank_m * cos(th), s.crank_m * sin(th))
    weight = (-s.counter_m * cos(th), -s.counter_m * sin(th))
    joint = (at.x, at.y)
    shapes = [
        Shape("crank", "line", (weight, (0.0, 0.0), crank), (200, 60, 40), 0.02),
        Shape("counterweight", "points", (weight,), (60, 60, 60), 0.05),
        Shape("joints", "points", ((0.0, 0.0), crank, joint), (0, 0, 0), 0.015),
    ]
    if s.kind >= FINITE_ROD:
        shapes.append(Shape("rod", "line", (crank, joint), (60, 90, 180), 0.012))
    else:
        shapes.append(Shape("rod", "line", (crank, (crank[0], at.y)), (60, 90, 180), 0.012))
    if s.kind == BOOM:
        pivot = (s.pivot_x_m, s.pivot_y_m)
        load = (pivot[0] + s.load_ratio * (at.x - pivot[0]), pivot[1] + s.load_ratio * (at.y - pivot[1]))
        shapes.append(Shape("boom", "line", (pivot, joint, load), (90, 140, 60), 0.02))
        shapes.append(Shape("load", "points", (load,), (90, 140, 60), 0.06))
    else:
        half = 0.3 * s.crank_m
        shapes.append(Shape("slider", "line", ((at.x - half, at.y), (at.x + half, at.y)), (90, 140, 60), 0.05))
    return tuple(shapes)


def _drive(p: VibrationCrank) -> tuple[MotorRole, Transmission | None]:
    step_s, rate = p.coupling.step_s, p.supply.rate_per_s
    if p.drive.kind == "constant_speed" or p.motor is None or p.gear is None:
        return PrescribedSpeed(p.drive.speed_rad_per_s, rate, step_s), None
    motor = KlossDrive(motor_constants(p.motor), p.gear.ratio, rate, step_s)
    return motor, Transmission(p.gear.ratio, p.gear.efficiency, p.motor.rotor_inertia_kg_m2)


def build(parameters: Parameters) -> Machine:
    """Return the vibration crank of these parameters."""
    if not isinstance(parameters, VibrationCrank):
        raise TypeError(f"expected VibrationCrank parameters, got {type(parameters).__name__}")
    p, s = parameters, shaker_constants(parameters)
    speed, fraction = p.drive.speed_rad_per_s, p.supply.initial_fraction
    motor, transmission = _drive(p)
    ground = ("boom_pivot", "boom") if s.kind == BOOM else ("guide", "slider")
    linkage: LinkageRole = CrankLinkage(
        s,
        CrankKernels(crank_state, prescribed_step, driven_step),
        p.coupling.step_s,
        0.0,
        0.0 if transmission else fraction * speed,
        fraction,
        ("crank", "rod", ground[1]),
        ground[1],
        transmission=transmission,
    )
    figures = cycle_report(p, s)
    forces = ShakerForceAnalysis(
        s,
        figures["drive_torque_peak_nm"],
        figures["shaking_force_max_n"],
        ("crank_bearing", "crank_pin", "follower_pin", ground[0]),
        ("crank", "rod", ground[1], ground[1]),
    )

    def analyse(crank_rad: float) -> dict[str, Any]:
        return position_figures(s, speed, crank_rad)

    return Machine(
        "vibration_crank",
        p,
        p.coupling.step_s,
        motor,
        linkage,
        forces,
        None,
        lambda sample, _: _drawing(s, sample),
        lambda: cycle_report(p, s),
        analyse,
        ShakerObserver,
    )


def capabilities() -> Capabilities:
    """Return what the machine answers beside running."""
    from mech_twin.capabilities.sizing import SizingQuestion
    from mech_twin.machines.vibration_crank import plots, published, sizing

    return Capabilities(
        published=published.rows,
        pictures=plots.pictures,
        sizing=SizingQuestion(sizing.LIMITS, sizing.OBJECTIVES, sizing.sizing),
    )
