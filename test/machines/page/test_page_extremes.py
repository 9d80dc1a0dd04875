# SPDX-License-Identifier: Apache-2.0
"""The largest force that a run tells is the largest of its samples, none of which lies above it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mech_twin as mt

PAGES = sorted((Path(__file__).resolve().parents[3] / "config" / "pages").glob("*.yaml"))


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_no_sample_of_a_run_lies_above_the_largest_force_told(page: Path) -> None:
    run = mt.simulate(str(page), 0.5)
    compared = 0
    for name, largest in run.summary.items():
        place = name.removesuffix("_force_max_n")
        columns = [f"forces.{place}.force_{axis}_n" for axis in "xy"]
        if place != name and all(column in run.samples for column in columns):
            compared += 1
            samples = np.hypot(*(np.asarray(run.samples[column]) for column in columns))
            assert largest == pytest.approx(samples.max(), rel=1e-12), name
    assert compared > 0
