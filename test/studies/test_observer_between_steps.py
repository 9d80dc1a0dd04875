# SPDX-License-Identifier: Apache-2.0
"""Samples whose instants lie between two steps of the model, through blows and touchdowns."""

from __future__ import annotations

import numpy as np
import pytest
from catalogue import built

from mech_twin.engine.rollout import roll_out
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.observer.estimate import SeenSample, SensedChannel
from mech_twin.studies.observer.observer import PhaseLockedObserver

NAME, CRANK, SIGMA_RAD = "mb10_breaker", "linkage.crank.position", 1e-3


@pytest.mark.slow
def test_a_step_with_a_blow_in_it_is_believed_at_any_instant_of_it() -> None:
    """Held at the frame after the event, a sample before it was off by a step of the crank and was not used."""
    machine, random = built(NAME), np.random.default_rng(1)
    run = roll_out(machine, 2.0, [CRANK])
    times, angles = run["time_s"], np.unwrap(run[CRANK])
    observer = PhaseLockedObserver(machine, catalogue_entry(NAME).build, [SensedChannel(CRANK, SIGMA_RAD)])
    place, errors = observer.columns[CRANK], []
    for at in times[:-1] + 4e-4 * random.random(len(times) - 1):
        angle = float(np.interp(at, times, angles))
        shown = angle + SIGMA_RAD * random.standard_normal()
        estimate = observer.take(SeenSample(float(at), (0,), (float(shown),)))
        if estimate is not None:
            off = np.mod(estimate.row[place] - angle + np.pi, 2.0 * np.pi) - np.pi
            errors.append(abs(off) / estimate.sigma[place])
    assert len(run.events) > 40
    assert len(errors) > 1700
    assert observer.counts["unbelievable"] <= 2  # of 1700 beyond five sigma; it was one in fifteen
    assert np.mean(np.array(errors) < 2.0) > 0.93
