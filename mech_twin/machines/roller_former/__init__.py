# SPDX-License-Identifier: Apache-2.0
"""Roller former: one to four carts on one crank shaft, induction motor, elastic drive."""

from functools import partial
from math import radians

from mech_twin.engine.compiled_roles import StepForces
from mech_twin.machines.catalog import usual_capabilities
from mech_twin.machines.drives import KlossMotor, kloss_motor_role
from mech_twin.machines.roller_former.drawing import former_drawing, mechanism
from mech_twin.machines.roller_former.metrics import FormerObserver, former_metrics, position_metrics
from mech_twin.machines.roller_former.parameters import RollerFormer, former_of
from mech_twin.machines.roller_former.roles import (
    CoupledFormer,
    FormerLinkage,
    force_layout,
    force_limits,
    loaded_bodies,
)
from mech_twin.roles import Capabilities, Machine

PARAMETERS = RollerFormer


def build(p: RollerFormer) -> Machine:
    """Return the roller former of these parameters."""
    former, count, step_s = former_of(p), p.carts.count, p.coupling.step_s
    model = CoupledFormer(former, step_s)
    linkage = FormerLinkage(
        model,
        step_s,
        radians(p.start.crank_deg),
        p.start.speed_fraction * p.synchronous_crank_speed_rad_per_s,
        p.supply.initial_fraction,
    )
    return Machine(
        "roller_former",
        p,
        step_s,
        kloss_motor_role(KlossMotor(former.motor, former.ratio, p.supply.rate_per_s, step_s)),
        linkage,
        StepForces(model, force_layout(count), loaded_bodies(count), force_limits(former.bank)),
        None,
        lambda sample, _: former_drawing(former, sample),
        partial(former_metrics, p, former),
        partial(position_metrics, former),
        FormerObserver,
        mechanism(former),
    )


def capabilities() -> Capabilities:
    """Return the machine's capabilities beyond running."""
    from mech_twin.machines.roller_former import metrics, published, sizing

    return usual_capabilities(
        metrics, published, sizing, works_taken=("damping_work_j", "load_work_j", "friction_work_j")
    )
