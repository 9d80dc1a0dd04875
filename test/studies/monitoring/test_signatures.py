# SPDX-License-Identifier: Apache-2.0
"""Signatures by roll-out: sizes between those declared, where the response of a machine bends."""

from __future__ import annotations

import numpy as np

from mech_twin.studies.monitoring.signatures import SteadyCycles, _bends, _between_bends

NOISE = np.diag([1e-4, 1e-4])


def at(size: float, scatter: float = 0.0) -> SteadyCycles:
    """Return a response that grows evenly up to a size of 0.3 and breaks off there."""
    mean = np.array([size, 3.0 * size if size <= 0.3 else 0.9 - 12.0 * (size - 0.3)])
    return SteadyCycles(mean, NOISE + scatter * np.eye(2), 20)


def test_sizes_are_added_about_a_bend_and_nowhere_else() -> None:
    sizes = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
    assert np.allclose(sorted(_between_bends({size: at(size) for size in sizes}, at(0.0))), [0.25, 0.35])


def test_what_scatters_needs_no_sizes_between() -> None:
    sizes = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
    wild = {size: at(size, 30.0 if size > 0.25 else 0.0) for size in sizes}
    assert _between_bends(wild, at(0.0)) == []


def test_half_the_step_of_a_parabola_leaves_a_quarter_of_its_bend() -> None:
    def bend(step: float) -> float:
        told = {x: SteadyCycles(np.array([x * x, 0.0]), NOISE, 20) for x in (1.0 - step, 1.0, 1.0 + step)}
        return float(_bends(told, SteadyCycles(np.zeros(2), NOISE, 20))[1.0][0][0])

    assert np.isclose(bend(0.1), -(0.1**2) / 4.0)
    assert np.isclose(bend(0.05) / bend(0.1), 0.25)
