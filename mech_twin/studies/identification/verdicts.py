# SPDX-License-Identifier: Apache-2.0
"""Verdict on each key after a fit, with its reason."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mech_twin.measurements.blocks import Array
from mech_twin.studies.identification.combinations import Combination
from mech_twin.studies.identification.sensitivity import ALONE, Sensitivity
from mech_twin.studies.identification.staged_search import Search

IDENTIFIED, ONE_SIDED, COMBINATION = "identified", "one-sided", "only_in_combination"
NOT_EXCITED, AT_BOUND = "not_excited", "at_bound"
MODEL_ERROR, NOT_CONVERGED = "model_error", "not_converged"
WIDEST = 0.5  # half width over value: a wider interval gives only the order of magnitude
NEAR_BOUND = 1e-6


@dataclass(frozen=True)
class KeyVerdict:
    """A key with its estimate, interval, verdict and reason."""

    key: str
    before: float
    estimate: float
    standard_error: float
    low_95: float
    high_95: float
    verdict: str
    reason: str


@dataclass(frozen=True)
class KeyEvidence:
    """Evidence for the verdicts; arrays have one entry per key, in SI units; half widths have two rows: down, up."""

    names: Sequence[str]
    before: Array
    estimates: Array
    errors: Array
    half_widths: Array
    bounds: Array
    scales: Array
    sensitivity: Sensitivity
    fixed: frozenset[int]
    refuted: tuple[str, str] | None


def refuted(off: str | None, search: Search) -> tuple[str, str] | None:
    """Return the common verdict and reason if noise does not explain the residuals; None if it does.

    If most starts ended in the best minimum, the model is incomplete; else the search may have missed the minimum.
    """
    if off is None:
        return None
    seen = f"{search.agreeing} of {search.starts} starts ended in the best of {search.valleys} local minima"
    if search.agreed:
        return MODEL_ERROR, f"{off}, and {seen}: the model lacks something"
    return NOT_CONVERGED, f"{off}, and {seen}: the fit has not found the keys"


def key_verdicts(evidence: KeyEvidence, combinations: Sequence[Combination]) -> list[KeyVerdict]:
    """Return the verdict on each key."""
    tied = {i: group for group in evidence.sensitivity.groups() for i in group}
    formulas = {key: f"{each.formula}, for {each.condition}" for each in reversed(combinations) for key in each.keys}
    formulas |= {each.keys[0]: f"{each.formula}, for {each.condition}" for each in combinations}
    return [_verdict(evidence, i, tied, formulas) for i in range(len(evidence.names))]


def _verdict(evidence: KeyEvidence, i: int, tied: Mapping[int, list[int]], formulas: Mapping[str, str]) -> KeyVerdict:
    name, estimate = evidence.names[i], float(evidence.estimates[i])
    down, up = evidence.half_widths[:, i].tolist()
    verdict, reason = _word(evidence, i, tied, formulas)
    if verdict in (NOT_EXCITED, COMBINATION) and i in evidence.fixed:
        down = up = np.inf
    low, high = max(estimate - down, float(evidence.bounds[0, i])), min(estimate + up, float(evidence.bounds[1, i]))
    return KeyVerdict(name, float(evidence.before[i]), estimate, float(evidence.errors[i]), low, high, verdict, reason)


def _word(evidence: KeyEvidence, i: int, tied: Mapping[int, list[int]], formulas: Mapping[str, str]) -> tuple[str, str]:
    """Return the verdict on a key and its reason."""
    unseen = _not_seen_alone(evidence, i, tied, formulas)
    if unseen is not None and (unseen[0] != COMBINATION or evidence.refuted is None):
        return unseen
    if evidence.refuted is not None:
        return evidence.refuted
    estimate = float(evidence.estimates[i])
    low, high = evidence.bounds[:, i].tolist()
    near = NEAR_BOUND * max(abs(estimate), float(evidence.scales[i]))
    if estimate - low < near or high - estimate < near:
        return AT_BOUND, f"the fit stopped at the bound {low if estimate - low < near else high:.6g}"
    down, up = evidence.half_widths[:, i].tolist()
    if np.isfinite(down) != np.isfinite(up):
        end = f"at least {estimate - down:.6g}" if np.isfinite(down) else f"at most {estimate + up:.6g}"
        return ONE_SIDED, f"{end}; to the other side the likelihood profile is flat"
    return _by_width(evidence, i, estimate, max(down, up))


def _by_width(evidence: KeyEvidence, i: int, estimate: float, half: float) -> tuple[str, str]:
    """Return the verdict by the width of the interval."""
    if not np.isfinite(half):
        return NOT_EXCITED, "the likelihood profile is flat on both sides"
    if half > WIDEST * abs(estimate):
        if evidence.before[i] == 0.0:
            return NOT_EXCITED, f"not significantly different from 0: 95 % within {half:.3g}"
        return NOT_EXCITED, f"95 % within {half:.3g} on either side, more than half its value"
    return IDENTIFIED, "observable, with an interval within half its value"


def _not_seen_alone(
    evidence: KeyEvidence, i: int, tied: Mapping[int, list[int]], formulas: Mapping[str, str]
) -> tuple[str, str] | None:
    """Return the verdict on a key without effect, or without an effect of its own; else None."""
    sensitivity = evidence.sensitivity
    if sensitivity.effects[i] < sensitivity.least_effects[i]:
        return NOT_EXCITED, "no channel changes by more than its noise if the key changes by all of itself"
    if sensitivity.left[i] < ALONE:
        return COMBINATION, "its effect equals that of zeros, gains, lags or the start state of the run"
    if i not in tied:
        return None
    partners = ", ".join(evidence.names[j] for j in tied[i] if j != i)
    if not evidence.fixed & set(tied[i]):
        return COMBINATION, f"its effect differs from that of {partners} by less than the error of the derivatives"
    formula = formulas.get(evidence.names[i])
    seen = f": observable is {formula}" if formula else ""
    return COMBINATION, f"its effect on the channels equals that of {partners}{seen}"
