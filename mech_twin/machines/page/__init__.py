# SPDX-License-Identifier: Apache-2.0
"""A planar machine from a page of YAML, with the names of its user."""

from functools import partial
from typing import Any

import numpy as np

from mech_twin.declarations.quantity import Parameters
from mech_twin.errors import StudyError
from mech_twin.machines.page.drawing import PageDrawing
from mech_twin.machines.page.equations import PageInstant
from mech_twin.machines.page.force_laws import PageNumbers
from mech_twin.machines.page.mechanism import mechanism
from mech_twin.machines.page.metrics import PageRun, run_remarks
from mech_twin.machines.page.parameters import Page
from mech_twin.machines.page.roles import Drives, PageLinkage, PageModel, PageReactions
from mech_twin.roles import Capabilities, Machine

PARAMETERS = Page


def build(parameters: Parameters) -> Machine:
    """Return the machine of a page."""
    if not isinstance(parameters, Page):
        raise TypeError(f"expected Page parameters, got {type(parameters).__name__}")
    shared = PageModel(parameters.expanded)
    shared.start_instant  # noqa: B018 # refuses what cannot start
    drawing = PageDrawing(shared)
    return Machine(
        "page",
        parameters,
        parameters.coupling.step_s,
        Drives(shared),
        PageLinkage(shared),
        PageReactions(shared),
        None,
        lambda sample, _: drawing.shapes(sample),
        partial(start_numbers, shared),
        partial(pose_numbers, shared),
        lambda: PageRun(shared),
        mechanism(shared),
        rests_when_supplied=True,
        gauge=shared.rods.gauge(),
        remarks=partial(run_remarks, shared),
    )


def capabilities() -> Capabilities:
    """Return the capabilities of a page besides running."""
    from mech_twin.capabilities.sizing import SizingQuestion
    from mech_twin.machines.page import metrics, sizing

    return Capabilities(
        sizing=SizingQuestion(sizing.LIMITS, sizing.OBJECTIVES, sizing.sizing),
        features=metrics.features,
        faults=metrics.faults,
        operating=metrics.operating,
    )


def start_numbers(shared: PageModel) -> dict[str, float]:
    """Return degrees of freedom, loop closures and masses of a page, and its energies at the start."""
    now, places = shared.start_instant, shared.places
    kinetic, potential = map(float, now.energies())  # type: ignore[arg-type]
    return {
        "freedoms": float(places.free),
        "driven_joints": float(places.driven),
        "closures": float(shared.assembly.structure.closures),
        "total_mass_kg": sum(body.mass_kg for body in shared.page.bodies.values()),
        "start_kinetic_energy_j": kinetic,
        "start_potential_energy_j": potential,
    }


def pose_numbers(shared: PageModel, angle: float) -> dict[str, Any]:
    """Return joints and outputs with the first independent turning joint at an angle, the others as at the start.

    Raises
    ------
    StudyError
        If no joint that turns is driven or free.
    """
    assembly, places = shared.assembly, shared.places
    split = assembly.split
    s = assembly.start.copy()
    turning = [j for j in (*split.driven, *split.free) if assembly.coordinates[j] not in assembly.slides]
    if not turning:
        raise StudyError("this page has no turning joint that is driven or free; expected one, at whose angle it is")
    first = turning[0]
    for value in np.linspace(s[first], angle, 32)[1:]:
        s[first] = value
        s = assembly.closed(s)
    state = list(shared.start_state)
    n = places.free
    for group, begin in ((split.free, 0), (split.dependent, 2 * n), (split.driven, 2 * n + places.dependent)):
        for i, j in enumerate(group):
            state[begin + i] = float(s[j])
    now = PageInstant(places, PageNumbers(None), [0.0] * places.controls, 0.0, state)
    motion = now.joint_motion()
    out: dict[str, Any] = {}
    for i, name in enumerate(assembly.columns):
        unit = "m" if name in assembly.slides else "rad"
        out[f"{name}_{unit}"], out[f"{name}_{unit}_per_s"] = float(motion[2 * i]), float(motion[2 * i + 1])  # type: ignore[arg-type]
    return out | {name: float(value) for name, value in now.outputs().items()}  # type: ignore[arg-type]
