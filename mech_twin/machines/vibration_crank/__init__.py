# SPDX-License-Identifier: Apache-2.0
"""Crank vibration mechanism with counterweight: drive moment, pin forces and the resulting force on the frame."""

from functools import partial

from mech_twin.engine.compiled_roles import StepForces
from mech_twin.engine.crank_linkage import FORCE_LIMITS, FORCE_RESIDUALS
from mech_twin.engine.sample_vectors import ForceLayout
from mech_twin.machines.catalog import usual_capabilities
from mech_twin.machines.vibration_crank.drawing import drawing, mechanism
from mech_twin.machines.vibration_crank.metrics import crank_run, cycle_metrics, position_metrics
from mech_twin.machines.vibration_crank.parameters import VibrationCrank, slider_crank_constants
from mech_twin.machines.vibration_crank.slider_crank import BOOM, QUANTITIES, LoadedCrank
from mech_twin.roles import Capabilities, Machine

PARAMETERS = VibrationCrank


def build(p: VibrationCrank) -> Machine:
    """Return the vibration crank of these parameters."""
    s = slider_crank_constants(p)
    ground = ("boom_pivot", "boom") if s.kind == BOOM else ("guide", "slider")
    motor, linkage = p.drive_roles(s, ("crank", "rod", ground[1]), ground[1], s.rod_m + s.boom_m)
    metrics = cycle_metrics(p, s)
    weights = s.gravity * (s.rotating_mass * s.crank_m + s.counter_mass * s.counter_m)
    pins = ("crank_bearing", "crank_pin", "follower_pin", ground[0])
    scale = max(metrics["drive_torque_peak_nm"], weights)
    forces = StepForces(
        LoadedCrank(s, s._replace(counter_mass=0.0), scale),
        ForceLayout(pins, QUANTITIES, FORCE_RESIDUALS),
        ("crank", "rod", ground[1], ground[1]),
        FORCE_LIMITS,
    )
    return Machine(
        "vibration_crank",
        p,
        p.coupling.step_s,
        motor,
        linkage,
        forces,
        None,
        lambda sample, _: drawing(s, sample),
        partial(cycle_metrics, p, s),
        partial(position_metrics, s, p.drive.speed_rad_per_s, p.drag_nm),
        partial(crank_run, p.motor_curve),
        mechanism(s),
        remarks=p.speed_remarks,
    )


def capabilities() -> Capabilities:
    """Return the capabilities of the machine besides running."""
    from mech_twin.machines.vibration_crank import metrics, published, sizing

    return usual_capabilities(metrics, published, sizing)
