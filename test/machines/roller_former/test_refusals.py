# SPDX-License-Identifier: Apache-2.0
"""A motion that cannot be followed is refused in one line that says what to change, whenever it is given up."""

import math

import pytest

from mech_twin.engine.hybrid.loop import UNSTEADY
from mech_twin.machines.roller_former.motion import Advance, ending


@pytest.mark.parametrize(("time_s", "said"), [(0.125, " at 0.125 s:"), (math.nan, " is small enough:")])
def test_a_turn_given_up_before_its_section_tells_no_time_that_is_none(time_s, said):
    line = ending(Advance(time_s, UNSTEADY, 10))
    assert said in line
    assert "1e-13 s" in line
    assert "integrator.tolerance" in line
    assert "nan" not in line
