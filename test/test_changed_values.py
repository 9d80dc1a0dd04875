# SPDX-License-Identifier: Apache-2.0
"""Each installed configuration with one key at another of its values runs, or is refused in one line."""

from __future__ import annotations

from functools import partial

import pytest
from catalogue import NAMES
from draws.keys import Changed, paired_changes, single_changes, told
from draws.outcomes import BROKEN, RAN, UNBUILT, outcome_of


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_one_key_at_another_of_its_values_runs_or_is_refused_in_one_line(name: str) -> None:
    singles = single_changes(name)
    found = [outcome_of(number, partial(Changed, name, made)) for number, made in enumerate(singles)]
    assert [f"{told(singles[end.number])}: {end.what}" for end in found if end.end == BROKEN] == []
    assert {RAN, UNBUILT} <= {outcome.end for outcome in found}


def test_the_pair_that_starts_on_a_dead_centre_under_a_load_that_does_not_hold_is_among_them() -> None:
    pairs = {told(made) for made in paired_changes("roller_former")}
    assert "load = rectified, start.load_from_fraction = 0.0" in pairs
