# SPDX-License-Identifier: Apache-2.0
"""Estimates while nothing is measured: the last ones, known ever less."""

from __future__ import annotations

import numpy as np

from mech_twin.engine.sample_vectors import Array
from mech_twin.studies.observer.model_run import ModelRun


def held_sigma(run: ModelRun, sigma: Array, silent_s: float) -> Array:
    """Return the standard deviation of an estimate that is held, shape (w,).

    A number may have gone anywhere its greatest rate of change takes it, and is after a while no better known than
    that it lies in its range: ``sigma^2 + min(rate silence, range)^2``.  An angle's range is a turn.

    Parameters
    ----------
    run : ModelRun
        The model's run, which tells ranges and rates.
    sigma : ndarray, shape (w,)
        Standard deviation at the last sample.
    silent_s : float
        Time since then.
    """
    way = np.minimum(run.steepest * max(silent_s, 0.0), run.spread)
    held: Array = np.hypot(sigma, way)
    return held
