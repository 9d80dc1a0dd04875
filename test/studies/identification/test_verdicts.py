# SPDX-License-Identifier: Apache-2.0
"""What may be said of keys that repeat each other, where the model fits and where it lacks something."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mech_twin.studies.identification.staged_fit import Search
from mech_twin.studies.identification.verdicts import (
    COMBINATION,
    IDENTIFIED,
    MODEL_ERROR,
    NOT_CONVERGED,
    NOT_EXCITED,
    Combination,
    KeyEvidence,
    Sensitivity,
    refuted,
)

OFF = "torque is off by 3"


@pytest.mark.parametrize(
    ("lacking", "verdict"),
    [(None, COMBINATION), ((MODEL_ERROR, OFF), MODEL_ERROR), ((NOT_CONVERGED, OFF), NOT_CONVERGED)],
)
def test_keys_that_repeat_each_other_carry_a_combination_only_where_the_model_fits(
    lacking: tuple[str, str] | None, verdict: str
) -> None:
    """What carries a combination is written into the configuration; nothing is where the model lacks something."""
    tie = np.array([[1.0], [-1.0]]) / np.sqrt(2.0)
    seen = Sensitivity(np.full(2, 50.0), np.ones(2), tie, np.eye(2), np.full(2, 2.0))
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
    found_verdicts = evidence.verdicts()
    assert [key.verdict for key in found_verdicts] == [verdict, verdict]
    assert (lacking[1] if lacking else "equals that of") in found_verdicts[0].reason


@pytest.mark.parametrize(("agreeing", "verdict"), [(2, NOT_CONVERGED), (3, MODEL_ERROR)])
def test_what_the_noise_refutes_is_the_models_fault_only_where_several_starts_end_alike(
    agreeing: int, verdict: str
) -> None:
    """A key with a narrow interval is not identified where the residual is more than the sensor's noise."""
    found = refuted(OFF, Search(5, 3, agreeing, 1.4))
    assert found is not None
    assert found[0] == verdict
    assert f"{agreeing} of 5 starts" in found[1]
    alone = Sensitivity(np.full(1, 50.0), np.ones(1), np.zeros((1, 0)), np.eye(1), np.full(1, 2.0))
    one, bounds = np.ones(1), np.array([[0.05], [20.0]])
    evidence = KeyEvidence(
        *(("mass",), one, one, 0.001 * one, np.full((2, 1), 0.002), bounds, one, alone, frozenset(), found)
    )
    assert [key.verdict for key in evidence.verdicts()] == [verdict]
    seen = replace(evidence, refuted=refuted(None, Search(1, 1, 1, np.inf)))
    assert [key.verdict for key in seen.verdicts()] == [IDENTIFIED]


@pytest.mark.parametrize(
    ("fixed", "word"), [(frozenset({1}), "equals that of force"), (frozenset(), "differs from that")]
)
def test_keys_are_called_tied_only_where_the_fit_fixes_one_of_them(fixed: frozenset[int], word: str) -> None:
    """Derivatives that two step lengths contradict say that keys are not told apart, and not that they go together."""
    tie = np.array([[1.0], [-1.0]]) / np.sqrt(2.0)
    seen = Sensitivity(np.full(2, 50.0), np.ones(2), tie, np.eye(2), np.full(2, 2.0))
    ones, bounds = np.ones(2), np.array([[0.05, 0.05], [20.0, 20.0]])
    evidence = KeyEvidence(
        *(("mass", "force"), ones, 1.1 * ones, 0.01 * ones, np.full((2, 2), 0.02), bounds, ones, seen, fixed, None)
    )
    found_verdicts = evidence.verdicts()
    assert [key.verdict for key in found_verdicts] == [COMBINATION, COMBINATION]
    assert word in found_verdicts[0].reason


def test_the_reason_says_for_which_values_of_a_fixed_key_a_combination_holds() -> None:
    tie = np.array([[1.0], [-1.0]]) / np.sqrt(2.0)
    seen = Sensitivity(np.full(2, 50.0), np.ones(2), tie, np.eye(2), np.full(2, 2.0))
    ones, bounds = np.ones(2), np.array([[0.05, 0.05], [20.0, 20.0]])
    evidence = KeyEvidence(
        *(("mass", "force"), ones, ones, ones, np.full((2, 2), 0.02), bounds, ones, seen, frozenset({1}), None)
    )
    ratio = Combination(
        "mass force^-1", "product", ("mass", "force"), (1.0, -1.0), 1.0, 0.9, 1.1, {"force": (0.5, 1.5)}
    )
    for key in replace(evidence, combinations=[ratio]).verdicts():
        assert key.reason.endswith("observable is mass force^-1, for force from 0.5 to 1.5")


@pytest.mark.parametrize(("effect", "verdict"), [(1.0, MODEL_ERROR), (0.0, NOT_EXCITED)])
def test_beside_a_refuted_fit_only_a_key_without_any_effect_is_called_not_excited(effect: float, verdict: str) -> None:
    """Its residuals count as noise, so that the effect of a key looks small there."""
    seen = Sensitivity(np.array([effect]), np.ones(1), np.zeros((1, 0)), np.eye(1), np.full(1, 2.0))
    one, bounds = np.ones(1), np.array([[0.05], [20.0]])
    lacking = (MODEL_ERROR, OFF)
    evidence = KeyEvidence(("mass",), one, one, one, np.ones((2, 1)), bounds, one, seen, frozenset(), lacking)
    (found,) = evidence.verdicts()
    assert found.verdict == verdict
