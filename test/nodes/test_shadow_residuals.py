# SPDX-License-Identifier: Apache-2.0
"""What a shadow shows of its residuals: each with the sigma by which its sample is believed or rejected."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
from catalogue import built
from wrong_machines import wrong_machine

from mech_twin.engine.rollout import roll_out
from mech_twin.nodes.shadow.viewer_node import channel_readings
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.observer.estimate import SeenSample, SensedChannel
from mech_twin.studies.observer.observer import PhaseLockedObserver

NAME, COLUMN, SIGMA_M = "impact_mass", "linkage.mass.position", 1e-4


def test_residuals_of_believed_samples_are_within_five_sigma_and_95_percent_within_two() -> None:
    build = catalogue_entry(NAME).build
    run, random = roll_out(wrong_machine(built(NAME).parameters, build, 0), 3.0), np.random.default_rng(0)
    shadow: Any = SimpleNamespace(observer=PhaseLockedObserver(built(NAME), build, [SensedChannel(COLUMN, SIGMA_M)]))
    shares, used = [], []
    for i in range(1500, len(run["time_s"]), 2):
        measured = float(run[COLUMN][i] + SIGMA_M * random.standard_normal())
        sample = SeenSample(float(run["time_s"][i]), (0,), (measured,))
        estimate = shadow.observer.take(sample)
        if estimate is not None:
            reading = channel_readings(shadow, estimate, sample)[COLUMN]
            shares.append(abs(reading.residual) / reading.sigma)
            used += estimate.used
    assert len(shares) > 400
    assert np.array_equal(np.array(shares) <= 5.0, used)
    assert np.mean(np.array(shares) <= 2.0) >= 0.95
