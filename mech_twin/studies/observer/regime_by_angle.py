# SPDX-License-Identifier: Apache-2.0
"""Load regime as a function of the crank angle, for machines whose load changes at fixed angles.

If a correction moves the crank past such an angle, the event there never occurs in the model.  So the regime is set to
that of the model's own run at this angle, if it is unique in the neighbourhood.
"""

from __future__ import annotations

import numpy as np

from mech_twin.engine.sample_vectors import Array
from mech_twin.studies.observer.model_run import ModelRun

TURN = 2.0 * np.pi
AROUND = 3  # frames on either side that must have the same regime


class RegimeByAngle:
    """Regimes of the settled run as a function of the angle.

    Parameters
    ----------
    run : ModelRun
        Simulated run of the model.
    angle : int or None
        Index of the crank angle; None without one.
    has_body : bool
        Whether the regimes come from the contact of a body, which is not a function of the angle.
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
        """Return a frame with the regime of its angle; unchanged if that is not unique."""
        if not self.in_use:
            return row
        at = int(np.searchsorted(self._phases, row[self._angle] % TURN))
        around = self._regimes[np.arange(at - AROUND, at + AROUND) % len(self._regimes)]
        if np.ptp(around) > 0.0 or around[0] == row[self._place]:
            return row
        repaired: Array = row.copy()
        repaired[self._place] = around[0]
        return repaired
