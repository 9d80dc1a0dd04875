# SPDX-License-Identifier: Apache-2.0
"""Signatures by roll-out: sizes between those declared, where the response of a machine bends; scatter where it has."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mech_twin.studies.monitoring.diagnosis import Signature
from mech_twin.studies.monitoring.sensing import SteadyCycles
from mech_twin.studies.monitoring.sensor_design import Cause, signature_of

NOISE = np.diag([1e-4, 1e-4])
SIZES = (0.1, 0.2, 0.3, 0.4, 0.5)


def signature(response: Callable[[float], SteadyCycles | None], sizes: tuple[float, ...] = SIZES) -> Signature | None:
    return signature_of(Cause("a", "a", "1", "", sizes, response), SteadyCycles(np.zeros(2), NOISE))


def at(size: float, scatter: float = 0.0) -> SteadyCycles:
    """Return a response that grows evenly up to a size of 0.3 and breaks off there."""
    mean = np.array([size, 3.0 * size if size <= 0.3 else 0.9 - 80.0 * (size - 0.3)])
    return SteadyCycles(mean, NOISE + scatter * np.eye(2))


def test_sizes_are_added_about_a_bend_and_nowhere_else() -> None:
    found = signature(at)
    assert found is not None
    assert set(SIZES) | {0.0} <= set(found.sizes)
    added = np.array(sorted({*found.sizes} - {0.0, *SIZES}))
    assert np.allclose(added, [0.25, 0.275, 0.325, 0.35])
    assert not found.scatter.size
    assert np.abs(found.doubt[list(found.sizes).index(0.3)]).max() > 0.02
    assert np.allclose(found.doubt[found.sizes < 0.27], 0.0)


def test_what_scatters_needs_no_sizes_between_and_tells_its_scatter() -> None:
    found = signature(lambda size: at(size, 3e4 if size > 0.25 else 0.0))
    assert found is not None
    assert len(found.sizes) == 6
    assert not found.doubt.size
    covariance = found.uncertainty(1e9) * 60.0
    assert np.allclose(covariance[:2], 0.0)
    assert np.allclose(covariance[3:], 3e4 * np.eye(2), rtol=1e-4, atol=1e-6)


def test_half_the_step_of_a_parabola_leaves_a_quarter_of_its_bend() -> None:
    def bend(step: float) -> float:
        sizes = (1.0 - step, 1.0, 1.0 + step)
        found = signature(lambda size: SteadyCycles(np.array([1e4 * (size - 1.0) ** 2, 0.0]), NOISE), sizes)
        assert found is not None
        return float(found.doubt[list(found.sizes).index(1.0)][0])

    assert np.isclose(bend(0.1) / bend(0.05), 4.0)


def test_a_size_that_the_machine_cannot_have_is_left_out() -> None:
    found = signature(lambda size: at(size) if size < 0.25 else None)
    assert found is not None
    assert set(found.sizes) == {0.0, 0.1, 0.2}
    assert signature(lambda size: None) is None
