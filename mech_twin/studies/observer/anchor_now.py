# SPDX-License-Identifier: Apache-2.0
"""Moves the time origin of a machine's closed-form motion, normally its last event, to the current frame."""

from __future__ import annotations

from typing import Any

from mech_twin.engine.sample_vectors import Array
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.observer.model_run import ModelRun


class AnchorNow:
    """Re-anchors frames at their own instant, if the machine's motion is given from an anchor; else leaves them.

    Parameters
    ----------
    run : ModelRun
        Simulated run of the model.
    machine_name : str
        Name of the machine in the catalogue.
    """

    def __init__(self, run: ModelRun, machine_name: str) -> None:
        self._motion = catalogue_entry(machine_name).capabilities.anchored_motion
        self._linkage = run.bank.compiled.layout.places.linkage
        self._model: Any = run.bank.compiled.models.linkage

    def restated(self, row: Array, step: int) -> Array:
        """Return a frame of the same motion, with its anchor at this step."""
        if self._motion is None:
            return row
        found: Array = row.copy()
        self._motion.anchor_at(self._model, found[self._linkage :], step)
        return found
