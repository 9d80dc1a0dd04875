# SPDX-License-Identifier: Apache-2.0
"""What may be said of keys that repeat each other, where the model fits and where it lacks something."""

from __future__ import annotations

import numpy as np
import pytest

from mech_twin.studies.identification.combinations import Combination, Sight
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
        frozenset({1}),
        lacking,
    )
    told = key_verdicts(evidence, [])
    assert [key.verdict for key in told] == [verdict, verdict]
    assert (lacking or "together with") in told[0].reason


@pytest.mark.parametrize(
    ("held", "word"), [(frozenset({1}), "together with force"), (frozenset(), "differs from that")]
)
def test_keys_are_called_tied_only_where_the_fit_holds_one_of_them(held: frozenset[int], word: str) -> None:
    """Derivatives that two step lengths contradict say that keys are not told apart, and not that they go together."""
    tie = np.array([[1.0], [-1.0]]) / np.sqrt(2.0)
    seen = Sight(np.full(2, 50.0), np.ones(2), tie, np.eye(2), np.full(2, 2.0))
    ones, bounds = np.ones(2), np.array([[0.05, 0.05], [20.0, 20.0]])
    evidence = KeyEvidence(
        *(("mass", "force"), ones, 1.1 * ones, 0.01 * ones, np.full((2, 2), 0.02), bounds, ones, seen, held, None)
    )
    told = key_verdicts(evidence, [])
    assert [key.verdict for key in told] == [COMBINATION, COMBINATION]
    assert word in told[0].reason


def test_the_reason_says_for_which_values_of_a_held_key_a_combination_holds() -> None:
    tie = np.array([[1.0], [-1.0]]) / np.sqrt(2.0)
    seen = Sight(np.full(2, 50.0), np.ones(2), tie, np.eye(2), np.full(2, 2.0))
    ones, bounds = np.ones(2), np.array([[0.05, 0.05], [20.0, 20.0]])
    evidence = KeyEvidence(
        *(("mass", "force"), ones, ones, ones, np.full((2, 2), 0.02), bounds, ones, seen, frozenset({1}), None)
    )
    ratio = Combination(
        "mass force^-1", "product", ("mass", "force"), (1.0, -1.0), 1.0, 0.9, 1.1, {"force": (0.5, 1.5)}
    )
    for key in key_verdicts(evidence, [ratio]):
        assert key.reason.endswith("they see mass force^-1, for force from 0.5 to 1.5")
