# SPDX-License-Identifier: Apache-2.0
"""The impact mass told from now on, not from its last event.

Its memory holds the motion at the last event: an impact, a change of the force, a change of what acts.  There the gap
is 0 exactly and what is uncertain is the instant, so gap and velocity at the anchor cannot carry the covariance through
an impact; and two frames of one motion with anchors at different instants have differences that mean nothing.  Told
from now on, gap and velocity are those of the mass, whatever has happened before.
"""

from __future__ import annotations

from typing import Any

from mech_twin.engine.sample_vectors import Array
from mech_twin.machines.impact_mass.mass_row import anchor_at
from mech_twin.studies.observer.model_run import ModelRun

NAME = "impact_mass"


class AnchorNow:
    """Anchors frames of the impact mass at their own instant; frames of other machines stay as they are.

    Parameters
    ----------
    run : ModelRun
        The model's run.
    machine_name : str
        Which machine.
    """

    def __init__(self, run: ModelRun, machine_name: str) -> None:
        self.in_use = machine_name == NAME
        self._linkage = run.bank.compiled.layout.places.linkage
        self._model: Any = run.bank.compiled.models.linkage

    def restated(self, row: Array, step: int) -> Array:
        """Return a frame at a step with the same motion, anchored there."""
        if not self.in_use:
            return row
        found: Array = row.copy()
        anchor_at(self._model, found[self._linkage :], step)
        return found
