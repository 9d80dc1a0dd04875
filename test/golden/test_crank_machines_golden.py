# SPDX-License-Identifier: Apache-2.0
"""Golden values of press, vibration crank and drum: our own earlier report and run.

A change that moves them on purpose rewrites them: ``python test/golden/test_crank_machines_golden.py``.
"""

import json
from pathlib import Path

import pytest

from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine

STORE = Path(__file__).with_name("crank_machines.json")
MACHINES = ("compaction_press", "vibration_crank", "winding_drum")


def figures(name):
    """Return report and running figures of half a second."""
    twin = machine(name)
    observer = twin.observer()
    for frame in frames(twin, 0.5):
        observer.observe(frame)
    return {"report": twin.report(), "run_of_0_5_s": observer.numbers()}


@pytest.mark.parametrize("name", MACHINES)
def test_figures_are_those_of_before(name):
    stored, found = json.loads(STORE.read_text(encoding="utf-8"))[name], figures(name)
    for part, numbers in stored.items():
        assert found[part].keys() == numbers.keys()
        for key, value in numbers.items():
            # figures that are zero but for rounding move with the order of sums
            assert found[part][key] == pytest.approx(value, rel=1e-9, abs=1e-8), (part, key)


if __name__ == "__main__":
    STORE.write_text(json.dumps({name: figures(name) for name in MACHINES}, indent=1) + "\n", encoding="utf-8")
