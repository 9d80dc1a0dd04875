# SPDX-License-Identifier: Apache-2.0
"""What may be said of keys that repeat each other, where the model fits and where it lacks something."""

from __future__ import annotations

import numpy as np
import pytest

from mech_twin.studies.identification.combinations import Sight
from mech_twin.studies.identification.verdicts import COMBINATION, MODEL_ERROR, KeyEvidence, key_verdicts


@pytest.mark.parametrize(("lacking", "verdict"), [(None, COMBINATION), ("torque: 3 % too much", MODEL_ERROR)])
def test_keys_that_repeat_each_other_carry_a_combination_only_where_the_model_fits(
    lacking: str | None, verdict: str
) -> None:
    """What carries a combination is written into the configuration; nothing is where the model lacks something."""
    tie = np.array([[1.0], [-1.0]]) / np.sqrt(2.0)
    seen = Sight(np.full(2, 50.0), np.ones(2), tie, np.eye(2), np.full(2, 2.0))
    ones, bounds = np.ones(2), np.array([[0.05, 0.05], [20.0, 20.0]])
    evidence = KeyEvidence(
        ("mass", "force"),
        ones,
        1.1 * ones,
        0.01 * ones,
        np.full((2, 2), 0.02),
        bounds,
        ones,
        seen,
        frozenset(),
        lacking,
    )
    told = key_verdicts(evidence, [])
    assert [key.verdict for key in told] == [verdict, verdict]
    assert (lacking or "together with") in told[0].reason
