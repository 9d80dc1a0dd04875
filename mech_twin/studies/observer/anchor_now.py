# SPDX-License-Identifier: Apache-2.0
"""Frames of a machine that goes on from its last event, told from their own instant."""

from __future__ import annotations

from typing import Any

from mech_twin.engine.sample_vectors import Array
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.observer.model_run import ModelRun


class AnchorNow:
    """Anchors frames at their own instant where a machine has an anchor; frames of other machines stay as they are.

    Parameters
    ----------
    run : ModelRun
        The model's run.
    machine_name : str
        Which machine.
    """

    def __init__(self, run: ModelRun, machine_name: str) -> None:
        self._motion = catalogue_entry(machine_name).capabilities.anchored_motion
        self._linkage = run.bank.compiled.layout.places.linkage
        self._model: Any = run.bank.compiled.models.linkage

    def restated(self, row: Array, step: int) -> Array:
        """Return a frame at a step with the same motion, anchored there."""
        if self._motion is None:
            return row
        found: Array = row.copy()
        self._motion.anchor_at(self._model, found[self._linkage :], step)
        return found
