# SPDX-License-Identifier: Apache-2.0
"""No legal configuration ends in a trace, a number that is not finite, or a broken invariant."""

from __future__ import annotations

import numpy as np
import pytest
from roller_former_random import broken, built_or_refused, drawn


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "number"), [*((7, number) for number in range(24)), (11, 11)])
def test_a_legal_configuration_runs_or_is_refused_in_one_line(seed: int, number: int) -> None:
    rng = np.random.default_rng([seed, number])
    carts, over = drawn(rng)
    over.pop("coupling.step_s", None)  # short steps are left to the long form
    twin = built_or_refused(carts, over)
    if isinstance(twin, str):
        assert any(key.split(".")[-1] in twin for key in over) or "guides lock" in twin, twin
    else:
        assert broken(twin, (1.0, float(rng.uniform()), 0.0, 1.0)) == "", over
