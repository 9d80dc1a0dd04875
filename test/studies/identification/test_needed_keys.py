# SPDX-License-Identifier: Apache-2.0
"""What is written of keys that are fitted beside others and known too badly to be called identified."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mech_twin.measurements.measurement_map import Channel
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.identification.fit_runs import FitRun, fit_channel, placed_run
from mech_twin.studies.identification.identification import Identification, identified
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.identification.written_identification import configuration_text
from mech_twin.studies.named_rollouts import rollout

CRANK, TORQUE = "linkage.crank.position", "motor.motor.effort"
PEAK, PLACE = "working_force.peak_n", "working_force.application_from_a_m"
TRUE = {
    PEAK: 12500.0, "working_force.exponent": 1.3, "working_force.contact_fraction": 0.42,
    "links.plate.mass_kg": 46.0, PLACE: 0.15,
}  # fmt: skip
NOISE_NM = 3.0


def pressed(seed: int) -> FitRun:
    """Return two seconds of a press whose layer is another one, and acts elsewhere, than configured."""
    random, run = np.random.default_rng(seed), rollout("compaction_press", 2.0, TRUE, columns=[CRANK, TORQUE])
    channels = []
    for name, sigma in ((CRANK, 1e-3), (TORQUE, NOISE_NM)):
        values = run[name] + sigma * random.standard_normal(len(run[name]))
        named = Channel.model_validate({"source": {"column": name}, "is": name})
        channels.append(fit_channel(named, run["time_s"], values, 0.0))
    return placed_run(Path("run"), channels, None, begin_known=True)


def found_of(seed: int) -> Identification:
    question = IdentificationQuestion("compaction_press", machine_parameters("compaction_press"), tuple(TRUE), cores=1)
    return identified(question, [pressed(seed)], share=0.2)


@pytest.mark.slow
def test_a_fitted_key_is_written_where_the_others_explain_the_runs_with_it_alone() -> None:
    """Peak and place of a layer are known together much better than the place alone."""
    found = found_of(0)
    by_key = {key.key: key for key in found.keys}
    assert by_key[PEAK].verdict == "identified"
    assert by_key[PLACE].verdict == "not_excited"
    assert found.parameters.working_force.application_from_a_m == by_key[PLACE].estimate
    assert "without it the others do not explain the runs" in by_key[PLACE].reason
    assert found.better
    torque = next(score for score in found.held_out.channels if score.channel == TORQUE)
    assert torque.rms == pytest.approx(NOISE_NM, rel=0.15)
    assert "# changed: not_excited" in configuration_text(found, ["run"])
