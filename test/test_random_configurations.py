# SPDX-License-Identifier: Apache-2.0
"""No legal configuration of any machine ends in a trace, a number that is not finite, or a broken residual.

The short form of `benchmarks/reliability/random_draws.py`, with fixed seeds.
"""

from __future__ import annotations

import math
from functools import partial

import pytest
from catalogue import NAMES
from draws.keys import leaves, value_at
from draws.outcomes import BROKEN, RAN, REFUSED_IN_RUN, Outcome, bad_refusal, outcome_of, run, worst_margin
from draws.random_draw import CORNERS, Draw

from mech_twin.engine.run import frames
from mech_twin.errors import MotionError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.description import description_text

SEED = 2
COUNT = 12
CORNER_STEPS = 1000
MOST_STEPS = 5000  # of a draw at the shortest coupling step, at which half a second takes minutes
machines = pytest.mark.parametrize("name", NAMES)


def drawn(name: str, seed: int, number: int) -> Outcome:
    """Return what became of one draw."""
    return outcome_of(number, partial(Draw, name, seed, number))


@pytest.mark.slow
@machines
@pytest.mark.parametrize("number", range(COUNT))
def test_a_legal_configuration_runs_and_what_is_refused_is_refused_in_one_line(name: str, number: int) -> None:
    draw = Draw(name, SEED, number)
    assert [bad_refusal(name, refused) for refused in draw.refused if bad_refusal(name, refused)] == []
    broken, _ = run(CATALOGUE[name].build(draw.parameters), draw.commands, MOST_STEPS)
    assert broken == "", f"{broken} {draw.commands}\n{description_text(name, draw.parameters)}"


@pytest.mark.parametrize(
    ("name", "number"),
    [
        *(("impact_mass", number) for number in range(40)),
        *(pytest.param("compaction_press", number, marks=pytest.mark.slow) for number in range(40)),
        *(pytest.param("vibration_crank", number, marks=pytest.mark.slow) for number in range(40)),
        *(pytest.param("roller_former", number, marks=pytest.mark.slow) for number in range(24)),
    ],
)
def test_a_configuration_with_many_values_at_corners_runs(name: str, number: int) -> None:
    """The second press has a crank too light for its loads: its first step is refused, with a shorter one to try."""
    found = outcome_of(number, partial(Draw, name, SEED, number, CORNERS), CORNER_STEPS)
    refused = (name, number) == ("compaction_press", 1)
    assert found.end == (REFUSED_IN_RUN if refused else RAN), f"{found.what}\n{found.text}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "seed", "number"),
    [
        *(("compaction_press", 6, number) for number in (151, 651, 1378)),
        *(("mb10_breaker", 6, number) for number in (100, 293, 316, 352, 462, 1903)),
        *(("compaction_press", 31, number) for number in (967, 1606)),
        *(("roller_former", 31, 306), ("impact_mass", 31, 197)),
    ],
)
def test_draws_that_were_broken_once_run_or_are_refused_in_one_line(name: str, seed: int, number: int) -> None:
    found = drawn(name, seed, number)
    assert found.end != BROKEN, found.what


@pytest.mark.slow
@pytest.mark.parametrize("number", [632, 673, 1737])
def test_a_crank_at_rest_that_two_rules_sent_to_and_fro_runs(number: int) -> None:
    """632 starts on dead centres that rounding tells apart; 673 is let go by friction that a driving load overcomes.

    1737 starts where a load that holds was, by rounding, one that drives.
    """
    assert drawn("roller_former", 6, number).end == RAN


@pytest.mark.slow
@machines
def test_the_draws_reach_every_key_and_are_refused_at_times(name: str) -> None:
    """What is optional may stay absent: a printed value has to fit the others closely."""
    draws = [Draw(name, SEED, number) for number in range(24)]
    keys = [leaf.path for leaf in leaves(CATALOGUE[name].parameters) if not leaf.optional]
    values = {".".join(path): {repr(value_at(draw.tree, path)) for draw in draws} for path in keys}
    assert {key for key, found in values.items() if len(found) < 2} == set()
    assert sum(len(draw.refused) for draw in draws) > 12


@pytest.mark.slow
@machines
def test_a_draw_is_the_same_each_time(name: str) -> None:
    drawn = Draw(name, SEED, 3).parameters
    assert Draw(name, SEED, 3).parameters == drawn
    assert Draw(name, SEED, 4).parameters != drawn


def test_a_residual_over_its_limit_and_one_that_is_nan_are_seen() -> None:
    machine = CATALOGUE["winding_drum"].build(Draw("winding_drum", SEED, 0).parameters)
    frame = next(iter(frames(machine, 0.0)))
    residuals = frame.linkage.residuals

    def margin(value: float) -> float:
        values = (value, *residuals.values[1:])
        linkage = frame.linkage._replace(residuals=residuals._replace(values=values))
        return worst_margin(machine, frame._replace(linkage=linkage))[0]

    assert margin(0.0) <= 1.0
    assert margin(2.0 * machine.linkage.residual_limits[residuals.names[0]]) == pytest.approx(2.0)
    assert margin(math.nan) == math.inf


@pytest.mark.parametrize(
    ("refusal", "end"),
    [
        (MotionError("coupling.step_s 0.1: must be at most 0.05 s"), REFUSED_IN_RUN),
        (MotionError("no step is small enough"), BROKEN),
        (MotionError("coupling.step_s 0.1:\nmust be at most 0.05 s"), BROKEN),
        (ZeroDivisionError("float division by zero of coupling.step_s 0.1"), BROKEN),
        (None, RAN),
    ],
)
def test_a_run_that_ends_is_refused_in_one_line_with_key_and_number_or_broken(monkeypatch, refusal, end):
    def ending(*_: object) -> tuple[str, float]:
        if refusal is not None:
            raise refusal
        return "", 0.0

    monkeypatch.setattr("draws.outcomes.run", ending)
    assert drawn("winding_drum", SEED, 0).end == end
