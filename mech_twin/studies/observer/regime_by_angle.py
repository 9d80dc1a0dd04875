# SPDX-License-Identifier: Apache-2.0
"""The regime that belongs to a crank angle, for machines whose load changes at fixed angles.

A correction that moves the crank past such an angle moves it past the event too, which then never comes. The regime
is therefore set to that of the model's own run at this angle, where the run has only that one in the neighbourhood.
"""

from __future__ import annotations

import numpy as np

from mech_twin.engine.sample_vectors import Array
from mech_twin.studies.observer.model_run import ModelRun

TURN = 2.0 * np.pi
AROUND = 3  # frames on either side that must agree


class RegimeByAngle:
    """Regimes of the settled run over the angle.

    Parameters
    ----------
    run : ModelRun
        The model's run.
    angle : int or None
        Place of the crank's angle; None where nothing turns.
    has_body : bool
        Whether a body's contact, which follows from no angle, makes the regimes.
    """

    def __init__(self, run: ModelRun, angle: int | None, *, has_body: bool) -> None:
        self._place = run.bank.columns["linkage.regime"]
        self._angle = angle
        rows = run.settled
        self.in_use = angle is not None and not has_body and bool(np.ptp(rows[:, self._place]) > 0.0)
        if not self.in_use:
            return
        phases = np.mod(rows[:, angle], TURN)
        order = np.argsort(phases)
        self._phases, self._regimes = phases[order], rows[order, self._place]

    def repaired(self, row: Array) -> Array:
        """Return a frame with the regime of its angle; the same frame where that is not certain."""
        if not self.in_use:
            return row
        at = int(np.searchsorted(self._phases, row[self._angle] % TURN))
        around = self._regimes[np.arange(at - AROUND, at + AROUND) % len(self._regimes)]
        if np.ptp(around) > 0.0 or around[0] == row[self._place]:
            return row
        repaired: Array = row.copy()
        repaired[self._place] = around[0]
        return repaired
