"""Golden values of the roller former, one to four carts: our own earlier summary and run.

A change that moves them on purpose rewrites them: ``python test/golden/test_roller_former_golden.py`` with ``test`` on
the path.
"""

import json
from pathlib import Path

import pytest
from roller_former_cases import machine_for

from mech_twin.engine.run import frames

STORE = Path(__file__).with_name("roller_former.json")


def figures(carts):
    """Return the summary, and the running figures of 1.6 s: the start and the load coming on."""
    twin = machine_for(carts)
    observer = twin.observer()
    for frame in frames(twin, 1.6):
        observer.observe(frame)
    return {"report": twin.report(), "run_of_1_6_s": observer.numbers()}


@pytest.mark.parametrize("carts", [1, 2, 3, 4])
def test_figures_are_those_of_before(carts):
    stored, found = json.loads(STORE.read_text(encoding="utf-8"))[str(carts)], figures(carts)
    for part, numbers in stored.items():
        assert found[part].keys() == numbers.keys()
        for key, value in numbers.items():
            assert found[part][key] == pytest.approx(value, rel=1e-8), (part, key)


if __name__ == "__main__":
    STORE.write_text(json.dumps({carts: figures(carts) for carts in (1, 2, 3, 4)}, indent=1) + "\n", encoding="utf-8")
