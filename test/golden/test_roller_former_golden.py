# SPDX-License-Identifier: Apache-2.0
"""Golden values of the roller former, one to four carts: our own earlier summary and run.

A change that moves them on purpose rewrites them: ``python test/golden/test_roller_former_golden.py`` with ``test`` on
the path.
"""

import json
from pathlib import Path

import pytest
from roller_former_cases import machine_for, parameters_for

from mech_twin.engine.run import frames
from mech_twin.machines.roller_former.metrics import moment_metrics
from mech_twin.machines.roller_former.parameters import former_of
from mech_twin.machines.roller_former.published import table_1_case, table_2_metrics

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


# worked by hand from the paper's formulas, before there was a twin: Table 1 (N m), then the load that reverses
LARGEST_RECTIFIED_NM = (734.49, 1186.20, 1466.59, 2011.18)
LARGEST_REVERSING_NM = (734.493, 1187.906, 1468.381, 2014.074)
TABLE_2 = {
    (2, 2000.0): (639.4, 0.00581, 0.1682, 5.64),
    (3, 2000.0): (774.8, 0.00775, 0.2490, 8.09),
    (4, 2000.0): (68.9, 0.000689, 0.0294, 1.259),
    (2, 8000.0): (320.6, 0.00291, 0.0761, 2.34),
    (3, 8000.0): (394.4, 0.00394, 0.1265, 4.07),
    (4, 8000.0): (33.0, 0.00033, 0.0141, 0.602),
}


@pytest.mark.parametrize(
    ("load", "mean_nm", "largest_nm", "digit_nm"),
    [("rectified", 452.68, LARGEST_RECTIFIED_NM, 5e-3), ("reversing", 453.404, LARGEST_REVERSING_NM, 5e-4)],
)
def test_static_moments_are_those_worked_from_the_formulas(load, mean_nm, largest_nm, digit_nm):
    for carts, most in enumerate(largest_nm, start=1):
        found = moment_metrics(former_of(table_1_case(parameters_for(2), carts, load)))
        assert found["moment_mean_per_cart_nm"] == pytest.approx(mean_nm, abs=digit_nm)
        assert found["moment_max_nm"] == pytest.approx(most, abs=digit_nm)


@pytest.mark.parametrize(("carts", "damping"), TABLE_2)
def test_table_2_is_that_worked_from_the_formulas(carts, damping):
    assert table_2_metrics(parameters_for(2), carts, damping) == pytest.approx(TABLE_2[carts, damping], rel=1.5e-3)


if __name__ == "__main__":
    STORE.write_text(json.dumps({carts: figures(carts) for carts in (1, 2, 3, 4)}, indent=1) + "\n", encoding="utf-8")
