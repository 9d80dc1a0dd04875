# SPDX-License-Identifier: Apache-2.0
"""Linkage of one's own: a crank that drives up to four dyads, from a page of configuration."""

from __future__ import annotations

from functools import cache
from typing import Any

from mech_twin.machines.crank_run import CrankRun
from mech_twin.machines.planar_linkage.drawing import drawing
from mech_twin.machines.planar_linkage.forces import LinkageForces
from mech_twin.machines.planar_linkage.mechanism import mechanism
from mech_twin.machines.planar_linkage.metrics import cycle_metrics, position_metrics
from mech_twin.machines.planar_linkage.parameters import PlanarLinkageParameters
from mech_twin.machines.planar_linkage.roles import planar_linkage_chain, planar_linkage_role
from mech_twin.quantity import Parameters
from mech_twin.roles import Capabilities, Machine

PARAMETERS = PlanarLinkageParameters


def build(parameters: Parameters) -> Machine:
    """Return the planar linkage of these parameters."""
    if not isinstance(parameters, PlanarLinkageParameters):
        raise TypeError(f"expected PlanarLinkageParameters, got {type(parameters).__name__}")
    p, chain = parameters, planar_linkage_chain(parameters)
    motor, _ = p.drive_roles()
    pins, acts_on = ["crank_bearing"], ["crank"]
    for key in p.dyads:
        pins += [f"{key}_from", f"{key}_between", f"{key}_to"]
        acts_on += [f"{key}_first", f"{key}_second", f"{key}_second"]

    @cache
    def metrics() -> dict[str, float]:
        return cycle_metrics(p, chain, tuple(pins))

    def analyse(crank_rad: float) -> dict[str, Any]:
        return position_metrics(p, chain, tuple(pins), crank_rad)

    return Machine(
        "planar_linkage",
        p,
        p.coupling.step_s,
        motor,
        planar_linkage_role(p, chain),
        LinkageForces(chain, metrics()["drive_torque_peak_nm"], tuple(pins), tuple(acts_on)),
        None,
        lambda sample, _: drawing(p, chain, sample),
        lambda: dict(metrics()),
        analyse,
        lambda: CrankRun(p.motor_curve),
        mechanism(p),
    )


def capabilities() -> Capabilities:
    """Return what the machine answers beside running."""
    from mech_twin.capabilities.sizing import SizingQuestion
    from mech_twin.machines.planar_linkage import sizing

    return Capabilities(sizing=SizingQuestion(sizing.LIMITS, sizing.OBJECTIVES, sizing.sizing))
