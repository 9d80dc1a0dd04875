"""Crank vibration mechanism with counterweight: drive moment, pin forces and the force it leaves on the frame."""

from __future__ import annotations

from typing import Any

from mech_twin.engine.crank_linkage import CrankKernels, CrankLinkage, Transmission
from mech_twin.machines.drives import KlossDrive, PrescribedSpeed, shaft_friction
from mech_twin.machines.vibration_crank.drawing import drawing
from mech_twin.machines.vibration_crank.dynamics import (
    DrivenCrank,
    LedCrank,
    crank_load_speed,
    crank_load_work,
    crank_state,
)
from mech_twin.machines.vibration_crank.forces import SliderCrankForces
from mech_twin.machines.vibration_crank.metrics import cycle_report, position_figures
from mech_twin.machines.vibration_crank.parameters import VibrationCrank, slider_crank_constants
from mech_twin.machines.vibration_crank.run_metrics import VibrationCrankObserver
from mech_twin.machines.vibration_crank.slider_crank import BOOM
from mech_twin.parts.induction_motor import motor_constants
from mech_twin.quantity import Parameters
from mech_twin.roles import Capabilities, LinkageRole, Machine, MotorRole

PARAMETERS = VibrationCrank


def _drive(p: VibrationCrank) -> tuple[MotorRole, Transmission | None]:
    step_s, rate = p.coupling.step_s, p.supply.rate_per_s
    if p.drive.kind == "constant_speed" or p.motor is None or p.gear is None:
        return PrescribedSpeed(p.drive.speed_rad_per_s, rate, step_s), None
    curve, direction = motor_constants(p.motor), 1.0 if p.drive.speed_rpm > 0.0 else -1.0
    motor = KlossDrive(curve, p.gear.ratio, rate, step_s, direction=direction)
    return motor, Transmission(p.gear.ratio, p.gear.efficiency, p.motor.rotor_inertia_kg_m2, curve)


def build(parameters: Parameters) -> Machine:
    """Return the vibration crank of these parameters."""
    if not isinstance(parameters, VibrationCrank):
        raise TypeError(f"expected VibrationCrank parameters, got {type(parameters).__name__}")
    p, s = parameters, slider_crank_constants(parameters)
    speed, fraction = p.drive.speed_rad_per_s, p.supply.initial_fraction
    motor, transmission = _drive(p)
    ground = ("boom_pivot", "boom") if s.kind == BOOM else ("guide", "slider")
    linkage: LinkageRole = CrankLinkage(
        s,
        CrankKernels(crank_state, crank_load_work, crank_load_speed, LedCrank, DrivenCrank),
        p.coupling.step_s,
        0.0,
        0.0 if transmission else fraction * speed,
        -fraction if transmission and speed < 0.0 else fraction,
        ("crank", "rod", ground[1]),
        ground[1],
        transmission=transmission,
        friction=shaft_friction(p.friction),
    )
    figures = cycle_report(p, s)
    forces = SliderCrankForces(
        s,
        figures["drive_torque_peak_nm"],
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
        lambda sample, _: drawing(s, sample),
        lambda: cycle_report(p, s),
        analyse,
        lambda: VibrationCrankObserver(None if transmission is None else transmission.motor),
    )


def capabilities() -> Capabilities:
    """Return what the machine answers beside running."""
    from mech_twin.capabilities.sizing import SizingQuestion
    from mech_twin.machines.vibration_crank import plots, published, sizing

    return Capabilities(
        published=published.rows,
        pictures=plots.pictures,
        sizing=SizingQuestion(sizing.LIMITS, sizing.OBJECTIVES, sizing.sizing, sizing.USUAL_TOLERANCE),
    )
