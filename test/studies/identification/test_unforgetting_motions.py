# SPDX-License-Identifier: Apache-2.0
"""What is called identified is right also where a small error of a key becomes large within the run."""

from __future__ import annotations

from pathlib import Path

import pytest
from studies.identification.independent_machines import BENCHES, hidden_draw

from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.runs import read_run
from mech_twin.measurements.tables import TableReader
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.identification.fit_runs import fit_run
from mech_twin.studies.identification.identification import identified
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.identification.verdicts import IDENTIFIED, NOT_CONVERGED

MOST = 4.0  # standard errors


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "verdict"), [(21, IDENTIFIED), (105, IDENTIFIED), (172, NOT_CONVERGED)])
def test_keys_of_a_motion_that_forgets_nothing_are_right_or_not_converged(
    tmp_path: Path, seed: int, verdict: str
) -> None:
    """In the last draw no two of fifteen starts end in one valley, and none explains the noise."""
    draw = hidden_draw(BENCHES["impact_mass"], seed)
    draw.write(tmp_path / "run.csv")
    run = fit_run(
        read_run(TableReader(tmp_path / "run.csv"), MeasurementMap.model_validate(draw.map_tree())), begin_known=True
    )
    question = IdentificationQuestion("impact_mass", machine_parameters("impact_mass"), draw.bench.keys, cores=1)
    found = identified(question, [run], (), 0.2)
    assert {key.verdict for key in found.keys} == {verdict}
    if verdict == IDENTIFIED:
        assert all(abs(key.estimate - draw.true[key.key]) < MOST * key.standard_error for key in found.keys)
