# SPDX-License-Identifier: Apache-2.0
"""The last minutes of a machine, kept sample by sample: what is kept of them, and that a fit to them finds a mass."""

from __future__ import annotations

import numpy as np
import pytest
from catalogue import built

from mech_twin.declarations.configuration_tree import configuration_tree, merged_tree, tree_from_flat
from mech_twin.engine.rollout import roll_out
from mech_twin.errors import MeasurementError
from mech_twin.measurements.measurement_map import Channel
from mech_twin.parameters.load import catalogue_entry, validated
from mech_twin.studies.identification.identification import HOLD_OUT_SHARE, identified
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.identification.recent_samples import RecentSamples
from mech_twin.studies.identification.written_identification import configuration_text
from mech_twin.studies.observer.estimate import SeenSample

NAME, KEY = "vibration_crank", "masses.extra_kg"
AT_FIRST = pytest.approx(0.0, abs=0.11)  # a sample apart
SIGMA = {"linkage.crank.position": 1e-3, "linkage.crank.effort": 2.0}


def channel(column: str, **more: float) -> Channel:
    return Channel.model_validate({"source": {"column": column}, "is": column, **more})


@pytest.mark.slow
def test_a_hidden_mass_is_found_in_the_last_seconds_and_what_was_held_out_is_foretold_better():
    entry, base = catalogue_entry(NAME), built(NAME).parameters
    hidden = validated(entry, merged_tree(configuration_tree(base), tree_from_flat({KEY: 9.0})), "hidden")
    run, random = roll_out(entry.build(hidden), 12.0), np.random.default_rng(3)
    recent = RecentSamples([channel(name, sigma=sigma) for name, sigma in SIGMA.items()], 10.0)
    for row in range(0, len(run["time_s"]), 20):
        for place, (name, sigma) in enumerate(SIGMA.items()):
            value = run[name][row] + sigma * random.standard_normal()
            recent.add(SeenSample(1000.0 + run["time_s"][row], (place,), (value,)))
    assert recent.span_s == 10.0
    question = IdentificationQuestion(NAME, base, (KEY,), longest_begin_s=10.0, cores=1)
    lines: list[str] = []
    run = recent.run(4.0)
    found = identified(question, [run], (), HOLD_OUT_SHARE, lines.append)
    (key,) = found.keys
    assert key.verdict == "identified"
    assert key.low_95 < 9.0 < key.high_95
    assert found.better
    assert configuration_tree(found.parameters)["masses"]["extra_kg"] == key.estimate
    assert "the last 4 s" in configuration_text(found, [str(run.path)])
    assert lines


def test_what_is_older_than_asked_for_is_let_go_and_late_samples_come_into_order():
    recent = RecentSamples([channel("linkage.crank.position")], 10.0)
    for time_s in (*np.arange(0.0, 200.0, 0.1), 199.55, 199.55):
        recent.add(SeenSample(float(time_s), (0,), (float(time_s),)))
    run = recent.run(5.0)
    times = run.channels[0].times_s
    assert run.begin_s is None
    assert times[0] == 0.0
    assert np.all(np.diff(times) > 0.0)
    assert times[-1] == pytest.approx(5.0, abs=0.11)
    assert np.ptp(run.channels[0].values) == pytest.approx(np.ptp(times))
    assert len(recent.run(1e6).channels[0].times_s) < 205 + 1


def test_a_command_that_was_given_before_the_stretch_holds_at_its_beginning():
    recent = RecentSamples([channel("linkage.crank.position")], 100.0)
    for row in range(600):
        recent.add(SeenSample(0.1 * row, (0,), (0.0,)))
        if row in (100, 500):
            recent.command({100: 0.5, 500: 0.25}[row])
    assert recent.run(30.0).command == ((AT_FIRST, 0.5), (pytest.approx(20.0, abs=0.2), 0.25))
    assert recent.run(5.0).command == ((AT_FIRST, 0.25),)


def test_too_few_samples_are_refused():
    recent = RecentSamples([channel("linkage.crank.position")], 10.0)
    with pytest.raises(MeasurementError, match="at least 20 samples"):
        recent.run(5.0)


@pytest.mark.slow
def test_a_fit_that_finds_nothing_says_so_and_not_that_what_was_held_out_is_predicted_badly():
    base = built(NAME).parameters
    run, random = roll_out(built(NAME), 2.0), np.random.default_rng(3)
    recent = RecentSamples([channel("linkage.crank.position", sigma=1e-3)], 10.0)
    for time_s, angle in zip(run["time_s"][::20], run["linkage.crank.position"][::20], strict=True):
        recent.add(SeenSample(float(time_s), (0,), (float(angle) + 1e-3 * random.standard_normal(),)))
    question = IdentificationQuestion(NAME, base, (KEY,), longest_begin_s=2.0, cores=1)
    found = identified(question, [recent.run(2.0)], (), HOLD_OUT_SHARE)
    assert found.lack == "no key is identified"
    assert not found.better
