# SPDX-License-Identifier: Apache-2.0
"""An advice goes out only after a yes, inside its limits, and is taken back where it does not do what it promised."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from catalogue import built
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.advice import (
    AdviceOutput,
    AdviceState,
    AdviceStep,
    AdviceWish,
    Recommendation,
    Setting,
    accepted,
    after_machine_cycle,
    ended,
    offered,
    overruled,
    rejected,
    watched,
)
from mech_twin.studies.advice_search import COMMAND, advice_model, recommendation

OUTPUT = AdviceOutput(key=COMMAND, low=0.5, high=1.0, value=1.0)
RULES = AdviceWish(
    figure="torque_peak_nm", wanted=0.0, output=OUTPUT, dry_run=False,
    interval_s=30.0, settling_cycles=2, trial_cycles=3, silence_s=5.0,
)  # fmt: skip
ADVICE = Recommendation(COMMAND, 1.0, 0.9, 0.5, 1.0, "torque_peak_nm", 40.0, 30.0, 50.0, "evidence", 100.0)
OFFERED = offered(AdviceState(), ADVICE, 0.0).state
ON_TRIAL = accepted(OFFERED, 60.0, 1.0, RULES).state
NAME = "vibration_crank"


def cycles(state: AdviceState, misses: list[float], begin_s: float = 2.0, *, fault: bool = False) -> list[AdviceStep]:
    found = []
    for i, miss in enumerate(misses):
        found.append(after_machine_cycle(state, miss, begin_s + i, fault, RULES))
        state = found[-1].state
    return found


def sent(step: AdviceStep) -> Setting | None:
    return None if step.decision is None else step.decision.sent


def test_nothing_goes_out_before_a_yes_and_a_dry_run_sends_nothing_at_all() -> None:
    assert sent(offered(AdviceState(), ADVICE, 0.0)) is None
    assert sent(rejected(OFFERED, 1.0)) is None
    dry = accepted(OFFERED, 60.0, 1.0, RULES.model_copy(update={"dry_run": True}))
    assert sent(dry) is None
    assert dry.state.phase == "idle"
    assert not dry.state.in_force
    assert sent(accepted(OFFERED, 60.0, 1.0, RULES)) == Setting(COMMAND, 0.9)


def test_a_gain_that_comes_is_kept_and_one_that_does_not_is_taken_back() -> None:
    kept = cycles(ON_TRIAL, [60.0, 60.0, 25.0, 25.0, 25.0])[-1]
    assert kept.decision is not None
    assert (kept.decision.what, kept.decision.sent, kept.state.in_force) == ("kept", None, True)
    reverted = cycles(ON_TRIAL, [10.0, 10.0, 45.0, 45.0, 45.0])[-1]
    assert reverted.decision is not None
    assert (reverted.decision.what, reverted.decision.sent) == ("reverted", Setting(COMMAND, 1.0))
    assert not reverted.state.in_force


def test_an_advice_that_was_kept_stays_in_force_when_the_next_is_taken_back() -> None:
    kept = cycles(ON_TRIAL, [60.0, 60.0, 25.0, 25.0, 25.0])[-1].state
    trial = accepted(offered(kept, ADVICE, 70.0).state, 25.0, 71.0, RULES).state
    back = rejected(trial, 72.0)
    assert sent(back) == Setting(COMMAND, 1.0)
    assert (back.state.phase, back.state.in_force) == ("idle", True)


def test_the_scatter_about_a_target_that_is_met_takes_no_advice_back() -> None:
    kept = cycles(ON_TRIAL, [60.0, 60.0, 50.0, -50.0, 0.0])[-1]
    assert kept.decision is not None
    assert (kept.decision.what, kept.decision.reason.startswith("gain 60 of 40 promised")) == ("kept", True)


@pytest.mark.parametrize(
    "step",
    [
        cycles(ON_TRIAL, [25.0], fault=True)[-1],
        watched(ON_TRIAL, 1.0 + RULES.silence_s + 0.1, RULES),
        rejected(ON_TRIAL, 2.0),
        ended(ON_TRIAL, 2.0),
    ],
    ids=["fault", "silence", "operator", "end"],
)
def test_a_trial_is_taken_back_by(step: AdviceStep) -> None:
    assert sent(step) == Setting(COMMAND, 1.0)
    assert step.state.phase == "idle"


def test_an_advice_ends_with_its_time_a_fault_or_a_no() -> None:
    late = accepted(OFFERED, 60.0, 100.5, RULES)
    assert late.decision is not None
    assert (late.decision.what, late.decision.sent) == ("expired", None)
    assert cycles(OFFERED, [60.0], fault=True)[-1].state.phase == "idle"
    assert cycles(OFFERED, [60.0], 101.0)[-1].state.phase == "idle"
    assert watched(OFFERED, 1e6, RULES).state is OFFERED


@pytest.mark.parametrize("state", [OFFERED, ON_TRIAL], ids=["offered", "trial"])
def test_an_output_that_another_has_changed_is_left_to_him(state: AdviceState) -> None:
    after = overruled(state, 2.0)
    assert after.decision is not None
    assert (after.decision.what, after.decision.sent) == ("withdrawn", None)
    assert (after.state.phase, after.state.in_force, after.state.changed_s) == ("idle", False, 2.0)
    assert overruled(AdviceState(), 2.0).decision is None


def test_two_changes_keep_their_distance_in_time() -> None:
    idle = cycles(ON_TRIAL, [25.0] * 5)[-1].state
    soon = accepted(offered(idle, ADVICE, 10.0).state, 60.0, 30.0, RULES)
    assert soon.decision is not None
    assert (soon.decision.what, soon.decision.sent, soon.state.phase) == ("refused", None, "offered")
    assert sent(accepted(offered(idle, ADVICE, 10.0).state, 60.0, 31.0, RULES)) == Setting(COMMAND, 0.9)


def test_a_value_outside_its_range_is_no_advice() -> None:
    with pytest.raises(ValueError, match=r"expected 0.5 to 1.0"):
        offered(AdviceState(), ADVICE._replace(proposed=1.2), 0.0)


def after(word: str, state: AdviceState, value: float, now: float) -> AdviceStep:
    """Return what comes of something that happens."""
    happenings = {
        "offer": lambda: offered(state, ADVICE._replace(value=value, expires_s=now + 100.0), now),
        "accept": lambda: accepted(state, 60.0, now, RULES),
        "reject": lambda: rejected(state, now),
        "good": lambda: after_machine_cycle(state, 10.0, now, False, RULES),
        "bad": lambda: after_machine_cycle(state, 70.0, now, False, RULES),
        "fault": lambda: after_machine_cycle(state, 10.0, now, True, RULES),
        "silence": lambda: watched(state, now, RULES),
        "end": lambda: ended(state, now),
    }
    return happenings[word]()


@given(st.lists(st.sampled_from(["offer", "accept", "reject", "good", "bad", "fault", "silence", "end"]), max_size=40))
def test_whatever_happens_the_machine_has_an_accepted_value_or_the_one_before(words: list[str]) -> None:
    state, now, value, yes = AdviceState(), 0.0, 1.0, False
    for word in words:
        now += 10.0
        step = after(word, state, value, now)
        going_out = sent(step)
        if going_out is not None:
            assert word == "accept" or state.phase == "trial"
            value, yes = going_out.value, True
        state = step.state
        assert yes or value == 1.0
        assert state.phase != "trial" or (state.advice is not None and value == state.advice.proposed)


def wish(**changes: object) -> AdviceWish:
    given_ = {"figure": "torque_peak_nm", "wanted": 150.0, "output": OUTPUT, "step_share": 0.2}
    return AdviceWish.model_validate({**given_, **changes})


COLUMNS = ("linkage.crank.position", "linkage.crank.effort")


def test_the_advice_of_a_speed_brings_the_torque_of_a_machine_with_other_masses_down_as_promised() -> None:
    """The peak goes as the square of the speed where weights do not matter; hidden masses shift its size."""
    entry, parameters = catalogue_entry(NAME), built(NAME).parameters
    model = advice_model(entry, parameters, wish(), COLUMNS)
    tree = parameters.model_dump() | {"masses": {**parameters.model_dump()["masses"], "boom_kg": 36.0, "extra_kg": 9.0}}
    hidden = type(parameters).model_validate(tree)
    before = model.figure(1.0, hidden)
    found = recommendation(model, 1.0, np.full(10, before), 5.0)
    assert found is not None
    assert 0.9 <= found.proposed < 1.0
    came = abs(before - 150.0) - abs(model.figure(found.proposed, hidden) - 150.0)
    assert found.gain_low <= came <= found.gain_high
    assert found.gain_low > 0.0
    assert found.expires_s == 605.0


def test_a_machine_that_is_where_it_should_be_gets_no_advice() -> None:
    model = advice_model(catalogue_entry(NAME), built(NAME).parameters, wish(), COLUMNS)
    assert (
        recommendation(replace(model, wish=wish(wanted=model.figure(1.0))), 1.0, np.full(5, model.figure(1.0)), 0.0)
        is None
    )


def test_a_change_without_a_gain_is_no_advice_where_the_target_is_zero(monkeypatch: pytest.MonkeyPatch) -> None:
    model = advice_model(catalogue_entry(NAME), built(NAME).parameters, wish(wanted=0.0), COLUMNS)
    monkeypatch.setattr(type(model), "figure", lambda self, value, parameters=None: 2.0)
    assert recommendation(model, 1.0, np.full(5, 2.0), 0.0) is None


def test_an_output_that_is_out_of_reach_of_its_range_gets_no_advice() -> None:
    model = advice_model(catalogue_entry(NAME), built(NAME).parameters, wish(), COLUMNS)
    assert recommendation(model, 0.3, np.full(5, 400.0), 0.0) is None


@pytest.mark.parametrize(
    "wrong", [{"cycles": 0}, {"cycles": -1}, {"trial_cycles": 0}, {"settling_cycles": -1}], ids=str
)
def test_a_wish_counts_whole_cycles_one_or_more(wrong: dict[str, int]) -> None:
    with pytest.raises(ValidationError, match="greater than or equal to"):
        wish(**wrong)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"figure": "blow_energy_j"}, "key 'figure', value 'blow_energy_j': expected one of period_s"),
        ({"output": {"key": "masses.boom_kg", "low": 1.0, "high": 9.0, "value": 2.0}}, "or a live parameter"),
        ({"output": {"key": COMMAND, "low": 0.5, "high": 0.9, "value": 1.0}}, "expected 0.5 to 0.9"),
        ({"output": {"key": COMMAND, "low": 1.0, "high": 0.5, "value": 1.0}}, "less than output.high, 0.5"),
        ({"output": {"key": COMMAND, "low": 1.0, "high": 1.0, "value": 1.0}}, "less than output.high, 1.0"),
        ({"output": {"key": COMMAND, "low": 0.5, "high": 1.2, "value": 1.0}}, "value 1.2: expected 0 to 1"),
        (
            {"output": {"key": "friction.coulomb_nm", "low": -1.0, "high": 5.0, "value": 0.0}},
            "'output.low', value -1.0: expected what friction.coulomb_nm may be",
        ),
    ],
)
def test_a_wish_that_cannot_be_had_is_told_in_one_line(changes: dict[str, object], line: str) -> None:
    with pytest.raises(ConfigurationError, match=line):
        advice_model(catalogue_entry(NAME), built(NAME).parameters, wish(**changes), COLUMNS)


def test_a_figure_that_lacks_a_channel_names_it() -> None:
    entry, parameters = catalogue_entry(NAME), built(NAME).parameters
    with pytest.raises(ConfigurationError, match=r"expected linkage.crank.effort in the map, or one of period_s"):
        advice_model(entry, parameters, wish(figure="torque_peak_nm"), COLUMNS[:1])


def test_the_printed_example_of_an_advice_holds_with_the_printed_map() -> None:
    page = (Path(__file__).parents[2] / "docs" / "shadow.md").read_text(encoding="utf-8")
    told, sensors = (yaml.safe_load(block) for block in re.findall(r"```yaml\n(.*?)```", page, re.DOTALL))
    columns = [channel.quantity for channel in MeasurementMap.model_validate(sensors).channels]
    entry, parameters = catalogue_entry(sensors["machine"]), built(sensors["machine"]).parameters
    assert advice_model(entry, parameters, AdviceWish.model_validate(told), columns).figure(1.0) > told["wanted"]
