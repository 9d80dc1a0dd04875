# SPDX-License-Identifier: Apache-2.0
"""Estimates while no samples arrive: the last values, with growing standard deviation."""

from __future__ import annotations

import numpy as np

from mech_twin.engine.sample_vectors import Array
from mech_twin.studies.observer.model_run import ModelRun


def held_sigma(run: ModelRun, sigma: Array, silent_s: float) -> Array:
    """Return the standard deviation of a held estimate, shape (w,).

    The error grows with the largest rate of change of a column, up to its range: the variance is
    ``sigma^2 + min(rate silence, range)^2``.  The range of an angle is at most a turn.

    Parameters
    ----------
    run : ModelRun
        Simulated run of the model, for ranges and rates.
    sigma : ndarray, shape (w,)
        Standard deviation at the last sample.
    silent_s : float
        Time since the last sample.
    """
    way = np.minimum(run.steepest * max(silent_s, 0.0), run.spread)
    held: Array = np.hypot(sigma, way)
    return held
