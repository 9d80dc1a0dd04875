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
from mech_twin.machines.impact_mass.mass_row import MEMORY_AT, ORIGIN_STEP, RESIDUALS_AT, acted_before, motion_of
from mech_twin.machines.impact_mass.step import reanchored
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
        self._system: Any = run.bank.compiled.models.linkage.system if self.in_use else None
        self._step_s = run.bank.step_s

    def restated(self, row: Array, step: int) -> Array:
        """Return a frame at a step with the same motion, anchored there."""
        if not self.in_use:
            return row
        found: Array = row.copy()
        memory = found[self._linkage + MEMORY_AT : self._linkage + RESIDUALS_AT]
        before = acted_before(self._system, memory)
        motion = reanchored(motion_of(memory), before, before, step - memory[ORIGIN_STEP], self._step_s)
        memory[: len(motion)] = motion
        return found
