# SPDX-License-Identifier: Apache-2.0
"""A root lies between two neighbouring doubles of different sign, or is one where the function is zero."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as some

from mech_twin.machines.drives import root_between


@given(some.floats(-1e6, 1e6), some.floats(1e-6, 1e6), some.floats(1e-6, 1e6), some.sampled_from([-1.0, 1.0]))
def test_the_function_changes_sign_at_the_root(root: float, below: float, above: float, slope: float) -> None:
    def cubed(x: float) -> float:
        return slope * ((x - root) + (x - root) ** 3)

    found = root_between(cubed, root - below, root + above)
    around = (math.nextafter(found, -math.inf), found, math.nextafter(found, math.inf))
    assert min(map(cubed, around)) <= 0.0 <= max(map(cubed, around))


@pytest.mark.parametrize(("low", "high", "expected"), [(2.0, 7.0, 2.0), (-1.0, 2.0, 2.0)])
def test_an_end_that_is_a_root_is_returned(low: float, high: float, expected: float) -> None:
    assert root_between(lambda x: x - 2.0, low, high) == expected


def test_ends_of_the_same_sign_are_refused_by_their_values() -> None:
    with pytest.raises(ValueError, match=r"same sign at 1 and 2: 3, 6"):
        root_between(lambda x: 3.0 * x, 1.0, 2.0)
