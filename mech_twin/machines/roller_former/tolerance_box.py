# SPDX-License-Identifier: Apache-2.0
"""What is assumed of a roller former, each within a tolerance: corners of the box they span, and points inside it.

Assumed are the loads (the print's, divided by what makes its tables come out: forces, weight and mass go together), the
efficiency of the gear, and the inertia counted in for the gearbox.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Any

import numpy as np

from mech_twin.capabilities.variation import varied
from mech_twin.machines.roller_former.parameters import SET_KEYS, RollerFormer

INSIDE = 16  # random points of the box


def assumed(parameters: RollerFormer, load: float, efficiency: float, inertia: float) -> RollerFormer:
    """Return the configuration with loads, efficiency and inertia factor multiplied by these."""
    p = parameters
    changes: dict[str, Any] = {f"carts.{key}": getattr(p.carts, key) * load for key in SET_KEYS}
    if p.carts.masses_kg is not None:
        changes["carts.masses_kg"] = [mass * load for mass in p.carts.masses_kg]
    changes["drive.efficiency"] = min(1.0, p.drive.efficiency * efficiency)
    changes["drive.inertia_factor"] = max(1.0, p.drive.inertia_factor * inertia)
    return varied(p, changes)


def corners(parameters: RollerFormer, tolerance: float) -> tuple[RollerFormer, ...]:
    """Return the configuration itself and, for a tolerance above 0, at the eight corners of the box."""
    if tolerance == 0.0:
        return (parameters,)
    ends = (1.0 - tolerance, 1.0 + tolerance)
    return (parameters, *_of(parameters, product(ends, repeat=3)))


def inside(parameters: RollerFormer, tolerance: float, seed: int = 1) -> tuple[RollerFormer, ...]:
    """Return the configuration at random points inside the box; none for a tolerance of 0."""
    if tolerance == 0.0:
        return ()
    points = np.random.default_rng(seed).uniform(1.0 - tolerance, 1.0 + tolerance, (INSIDE, 3))
    return _of(parameters, points.tolist())


def _of(parameters: RollerFormer, points: Iterable[Iterable[float]]) -> tuple[RollerFormer, ...]:
    return tuple(assumed(parameters, *point) for point in points)
