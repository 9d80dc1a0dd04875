# SPDX-License-Identifier: Apache-2.0
"""Four-bar shock-vibration compaction press: exact kinematics, every pin force, gain and flywheel."""

from functools import partial

from mech_twin.engine.compiled_roles import StepForces
from mech_twin.engine.crank_linkage import FORCE_LIMITS
from mech_twin.machines.catalog import usual_capabilities
from mech_twin.machines.compaction_press.cycle import POSITIONS, press_cycle
from mech_twin.machines.compaction_press.drawing import drawing, mechanism
from mech_twin.machines.compaction_press.dynamics import ACTS_ON, FORCES, JOINTS, LoadedPress, layer_regimes
from mech_twin.machines.compaction_press.metrics import cycle_metrics, position_metrics, press_run
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants
from mech_twin.roles import Capabilities, Machine

PARAMETERS = CompactionPress


def build(p: CompactionPress) -> Machine:
    """Return the compaction press of these parameters."""
    press, stroke = press_constants(p)
    size_m = press.bar.coupler_m + press.bar.rocker_m
    layer = layer_regimes(stroke, p.direction, p.working_force.gives_back)
    motor, linkage = p.drive_roles(press, JOINTS, "plate", size_m, **layer)
    torque = press_cycle(press, stroke, p.drive.speed_rad_per_s, POSITIONS, kinks=False).drive_torque_nm
    return Machine(
        "compaction_press",
        p,
        p.coupling.step_s,
        motor,
        linkage,
        StepForces(LoadedPress(press, float(abs(torque).max())), FORCES, ACTS_ON, FORCE_LIMITS),
        None,
        lambda sample, _: drawing(press, sample),
        partial(cycle_metrics, p),
        partial(position_metrics, p),
        partial(press_run, p.motor_curve),
        mechanism(press),
        remarks=p.speed_remarks,
    )


def capabilities() -> Capabilities:
    """Return the capabilities of the machine besides running."""
    from mech_twin.capabilities.design import DesignQuestion
    from mech_twin.machines.compaction_press import design_search, metrics, published, sizing
    from mech_twin.machines.compaction_press.design_problem import SENSES

    bounds, limits = design_search.BOUNDS, design_search.LIMITS
    design = DesignQuestion(bounds, limits, SENSES._asdict(), design_search.evaluated, design_search.searched)
    return usual_capabilities(metrics, published, sizing, design=design)
