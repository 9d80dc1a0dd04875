# SPDX-License-Identifier: Apache-2.0
"""Long-run regimes: each told by its stated rule."""

from __future__ import annotations

import numpy as np
import pytest
from machines.impact_mass.release_reference import periods_between_releases
from pydantic import ValidationError

from mech_twin.capabilities.variation import varied
from mech_twin.machines.impact_mass.long_run_answers import regime_answer
from mech_twin.machines.impact_mass.regimes import regime_of
from mech_twin.parameters.load import machine_parameters

BASE = machine_parameters("impact_mass")


def at(**changes):
    return machine_parameters("impact_mass", overrides=changes)


def test_figure_2_is_a_period_1_motion_with_completed_chatter():
    found = regime_of(BASE)
    assert (found.kind, found.period, found.impacts_per_period, found.completed_chatter) == ("periodic", 1, (-1,), True)
    assert found.blows_m_per_s == pytest.approx([12.9904], abs=5e-5)


def test_figure_3b_is_an_exact_period_5_motion():
    found = regime_of(at(phase1_duration_s=0.03))
    assert (found.kind, found.period) == ("periodic", 5)
    assert sorted(found.impacts_per_period) == [-1, 1, 1, 1, 1]


def test_a_motion_has_one_list_of_impacts_wherever_its_periods_are_counted_from():
    found = [regime_of(at(phase1_duration_s=0.0316), settling) for settling in range(1000, 1007)]
    assert {each.impacts_per_period for each in found} == {(1, 3, 1, 2, 4, 1, -1)}
    assert {each.blows_m_per_s for each in found} == {found[0].blows_m_per_s}


@pytest.mark.parametrize(
    ("restitution", "phase1_s", "force_n"),
    [(0.21439, 0.02233, -149.13645), (0.31247, 0.02081, -95.90603), (0.53174, 0.01826, -30.6884)],
)
def test_a_motion_that_settles_by_turns_on_either_side_has_a_period_of_1(restitution, phase1_s, force_n):
    found = regime_of(at(restitution=restitution, phase1_duration_s=phase1_s, phase2_force_n=force_n))
    assert (found.kind, found.period, found.impacts_per_period) == ("periodic", 1, (1,))


def test_a_negative_mean_force_escapes_and_a_positive_one_does_not():
    border = 0.05 / 3.0  # 1000 t1 = 500 (T - t1)
    assert regime_of(at(phase1_duration_s=border * 0.999)).kind == "escape"
    assert regime_of(at(phase1_duration_s=border * 1.01)).kind != "escape"


def test_two_forces_towards_the_stop_end_at_rest():
    assert regime_of(at(phase2_force_n=100.0)).kind == "rest"


def test_a_stable_one_impact_motion_is_found_by_return():
    found = regime_of(
        at(
            period_s=0.05 + 1 / 6,
            phase1_duration_s=0.05,
            phase1_force_n=26.0 / 0.05 + 20.0 / 0.05 / 6,
            phase2_force_n=-20.0,
        )
    )
    assert (found.kind, found.period, found.impacts_per_period) == ("periodic", 1, (1,))
    assert found.blows_m_per_s == pytest.approx([20.0], rel=1e-9)
    assert not found.completed_chatter


def test_chaos_has_a_positive_exponent():
    found = regime_of(at(restitution=0.95, phase1_duration_s=0.03))
    assert found.kind == "chaotic"
    assert 0.1 < found.exponent_per_period < 2.0


def test_the_completed_chatter_of_period_1_begins_where_the_closed_form_says():
    share = 0.5 + np.sqrt(0.75) * (1 + 0.6 / 0.7)
    border = 0.05 * share / (1 + share)
    before, after = (regime_of(at(phase1_duration_s=border * share)) for share in (0.995, 1.001))
    assert after.period == 1
    assert before.period != 1


def test_a_map_sweeps_any_key_tells_progress_and_is_drawn(tmp_path):
    steps = []
    values = np.linspace(0.2, 0.6, 9).tolist()
    swept = regime_answer(BASE, values, "restitution", 1000, lambda done, of: steps.append((done, of)))
    assert steps[-1] == (9, 9)
    assert len(swept.records) == 9
    assert {record["kind"] for record in swept.records} <= {
        "periodic",
        "not resolved",
        "rest",
        "escape",
        "chaotic",
        "undecided",
    }
    picture = tmp_path / "map.png"
    swept.write_picture(picture)
    assert picture.stat().st_size > 5_000


def test_a_value_that_makes_no_configuration_is_refused():
    with pytest.raises(ValidationError, match="0 < phase1_duration_s < period_s"):
        regime_answer(BASE, [0.03, 0.06], "phase1_duration_s", 1000)


# value, period in 200 digits; the refused ones come out of doubles as 88, 42, 107, 58, 52, 45, 41, 48, 45, 98, 37
LENGTHS = [
    ("phase1_duration_s", 0.03, 5),
    ("phase1_duration_s", 0.025, 2),
    ("phase1_duration_s", 0.0205, 22),
    ("phase1_duration_s", 0.0226, 22),
    ("phase1_duration_s", 0.0229, 34),
    ("phase1_duration_s", 0.0219, 80),
    ("phase1_duration_s", 0.0235, 41),
    ("phase1_duration_s", 0.0202, 62),
    ("phase1_duration_s", 0.0218, 51),
    ("phase1_duration_s", 0.02295, 63),
    ("phase1_duration_s", 0.02115, 51),
    ("phase1_duration_s", 0.0313, 36),
    ("phase1_duration_s", 0.0315, 28),
    ("restitution", 0.36, 15),
    ("restitution", 0.62, 11),
    ("restitution", 0.65, 32),
    ("restitution", 0.78, 51),
    ("restitution", 0.63, 49),
    ("phase2_force_n", -770.0, 17),
    ("phase2_force_n", -625.0, 14),
]


@pytest.mark.parametrize(("key", "value", "length"), LENGTHS)
def test_a_period_is_that_of_200_digits_or_it_is_refused_with_its_growth(key, value, length):
    parameters = varied(BASE, {key: value})
    system = parameters.system
    case = {"T": system.period_s, "t1": system.phase1_s, "R": system.restitution}
    case |= {"A1": system.acceleration1, "A2": system.acceleration2}
    assert periods_between_releases(case, 200) == length
    found = regime_of(parameters)
    if found.note:
        assert found.kind == "not resolved"
        assert found.period == 0
        assert found.note == f"period not resolved, growth {found.growth:.0e}"
        assert found.growth > 1e13
    else:
        assert (found.kind, found.period) == ("periodic", length)


@pytest.mark.parametrize(
    ("changed", "from_doubles", "from_decimals"),
    [({"t1": "0.0219"}, 80, 45), ({"t1": "0.0235"}, 41, 39), ({"t1": "0.0202"}, 62, 61), ({"R": "0.78"}, 51, 821)],
)
def test_a_long_period_is_another_from_the_decimals_than_from_the_doubles_nearest_to_them(
    changed, from_doubles, from_decimals
):
    """821 periods let a difference grow by more than 600 digits: 600 and 1000 digits agree, 200 do not."""
    decimals = {"T": "0.05", "t1": "0.035", "A1": "1000", "A2": "-500", "R": "0.3", **changed}
    doubles = {name: float(value) for name, value in decimals.items()}
    for digits in (600, 1000):
        assert periods_between_releases(decimals, 1000, digits) == from_decimals
        assert periods_between_releases(doubles, 1000, digits) == from_doubles


def test_of_the_twenty_lengths_those_that_are_rounding_are_refused_and_no_other():
    refused = {(key, value) for key, value, _ in LENGTHS if regime_of(varied(BASE, {key: value})).note}
    assert refused == {(key, value) for key, value, _ in LENGTHS[5:13] + LENGTHS[15:18]}
