# SPDX-License-Identifier: Apache-2.0
"""Features without a machine: autoregressive vectors with a known change."""

from __future__ import annotations

import numpy as np

from mech_twin.studies.monitoring.cycle_features import FeatureVector

PERIOD_S = 0.1


def vectors(rows: np.ndarray, first: int = 0) -> list[FeatureVector]:
    """Return rows of features as consecutive cycles of a tenth of a second."""
    names = tuple(f"feature_{i}" for i in range(rows.shape[1]))
    return [
        FeatureVector(number, number * PERIOD_S, (number + 1) * PERIOD_S, names, row)
        for number, row in enumerate(rows, first)
    ]


def autoregressive(cycles: int, coefficients: np.ndarray, covariance: np.ndarray, seed: int) -> np.ndarray:
    """Return healthy rows (n, d) about 0: x_t = sum a_i x_(t-i) + e_t, settled."""
    random, settling = np.random.default_rng(seed), 500
    order, width = coefficients.shape
    shocks = random.multivariate_normal(np.zeros(width), covariance, cycles + settling)
    rows = np.zeros((cycles + settling + order, width))
    for t in range(cycles + settling):
        rows[t + order] = shocks[t] + sum(coefficients[i] * rows[t + order - 1 - i] for i in range(order))
    return rows[settling + order :]
