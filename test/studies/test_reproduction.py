# SPDX-License-Identifier: Apache-2.0
"""The comparison with the sources: it holds, it is computed, and it notices."""

import math
from functools import cache

import pytest

from mech_twin.capabilities.published import FAILED, Literature
from mech_twin.capabilities.variation import varied
from mech_twin.cli.reproduce import reproduce_machines
from mech_twin.cli.verbs import ReproduceVerb
from mech_twin.errors import StudyError
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.machines.mb10_breaker.published import load_rows, paper_body
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies import declared_studies, reproduce
from mech_twin.studies.declared_studies import all_hold, machines_with_published_values

pytestmark = pytest.mark.slow

CHANGES = {
    "roller_former": ("carts.crank_m", 0.21),
    "vibration_crank": ("masses.tree_kg", 60.0),
    "compaction_press": ("linkage.crank_m", 0.055),
    "impact_mass": ("restitution", 0.35),
    "mb10_breaker": ("body.restitution", 0.5),
    "winding_drum": ("eccentricity_m", 0.005),
}


rows_of = cache(declared_studies.machine_rows)


@pytest.fixture
def each_machine_computed_once(monkeypatch):
    """Take the rows of every machine from those that other tests have computed already."""
    monkeypatch.setattr(declared_studies, "machine_rows", rows_of)


@pytest.mark.parametrize("machine", machines_with_published_values())
def test_every_gated_row_holds(machine):
    rows = rows_of(machine)
    assert [row for row in rows if not row.holds] == []
    assert any(row.gated for row in rows)
    assert all(row.reason and "\n" not in row.reason for row in rows)


@pytest.mark.parametrize(("machine", "change"), CHANGES.items())
def test_a_changed_input_changes_what_is_computed_and_breaks_gated_rows(machine, change):
    after = reproduce(machine, varied(machine_parameters(machine), dict([change])))
    assert [row.computed for row in after] != [row.computed for row in rows_of(machine)]
    assert all(row.gated for row in after if not row.holds)
    if machine != "winding_drum":  # the fragment prints no number that a changed drum could miss
        assert not all_hold(after)


def test_every_gated_row_of_the_impact_mass_fails_for_some_change_and_no_printed_number_moves():
    before = rows_of("impact_mass")
    parameters = machine_parameters("impact_mass")
    changes = {"restitution": 0.9}, {"initial_position_m": -0.3}, {"phase1_force_n": 2000.0}
    runs = [reproduce("impact_mass", varied(parameters, change)) for change in changes]
    for row, *changed in zip(before, *runs, strict=True):
        assert {each.published for each in changed} == {row.published}
        assert not row.gated or not all(each.holds for each in changed), row


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("machine", "change"),
    [
        ("vibration_crank", {"counterweight.mass_kg": 0.0}),
        ("mb10_breaker", {"excitation.kind": "approximated", "excitation.amplitude_nm": 0.0}),
        ("mb10_breaker", {"motor.rated_power_w": 1.5}),
        ("impact_mass", {"phase1_force_n": -10.0}),
    ],
)
def test_a_machine_that_lacks_what_a_row_is_about_is_compared_as_well(machine, change):
    """No counterweight, no load of the body, no motor that turns the crank, no blow."""
    rows = reproduce(machine, varied(machine_parameters(machine), change))
    assert len(rows) == len(rows_of(machine))
    assert not all_hold(rows)


def test_a_mass_that_starts_at_its_stop_is_refused_in_one_line():
    at_stop = varied(machine_parameters("impact_mass"), {"initial_position_m": 0.0})
    with pytest.raises(StudyError, match="initial_position_m < stop_position_m does not hold"):
        reproduce("impact_mass", at_stop)


def test_a_period_whose_print_leaves_no_second_phase_has_no_row():
    """A stroke of half a millimetre: T is 0.2 ms, cut to three decimals 0."""
    near = varied(machine_parameters("impact_mass"), {"initial_position_m": -0.0005})
    assert [row.quantity for row in reproduce("impact_mass", near) if "permanent rest" in row.quantity] == []


def test_a_drum_without_eccentricity_has_no_row_of_the_eccentric_term():
    rows = reproduce("winding_drum", varied(machine_parameters("winding_drum"), {"eccentricity_m": 0.0}))
    assert [row.quantity for row in rows if "eccentric" in row.quantity] == []
    assert all_hold(rows)


def test_the_row_of_the_load_of_the_breaker_takes_the_frequency_that_acts():
    changed = paper_body(machine_parameters("mb10_breaker"))
    body = pressed_body(changed.body, changed.excitation)
    assert all(row.holds for row in load_rows(body) if row.gated)
    assert not any(row.holds for row in load_rows(body._replace(mu=1.01 * body.mu)) if row.gated)


def test_the_contradictions_of_the_sources_come_first(each_machine_computed_once):
    rows = reproduce()
    verdicts = [row.verdict == "contradicts itself" for row in rows]
    assert verdicts == sorted(verdicts, reverse=True)
    sources = list(
        dict.fromkeys(row.source for row, first in zip(rows, verdicts, strict=True) if first and not row.gated)
    )
    assert [name.split()[0].strip(",") for name in sources] == [
        "Alisher",
        "Asfandiyarov",
        "Lastochkin",
        "Manzhosov",
        "Loveikin",
        "winding",
    ]


def test_the_table_fits_80_columns(each_machine_computed_once, capsys):
    reproduce_machines(ReproduceVerb())
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > len(machines_with_published_values())
    assert max(map(len, lines)) <= 80


def test_errors_mean_what_the_measure_says():
    at = Literature("a", "b", "c")
    assert at.gated("x", 2.0, 2.1, "why", relative=0.051).holds
    assert not at.gated("x", 2.0, 2.1, "why", relative=0.049).holds
    assert at.gated("x", 0.0, -0.1, "why", absolute=0.1).error == pytest.approx(-0.1)
    assert at.limit("x", 20.0, 13.0, "why", "below").holds
    assert at.limit("x", 20.0, 13.0, "why", "above").verdict == FAILED
    assert not at.gated("x", 1.0, math.nan, "why", absolute=1.0).holds
    assert at.reported("x", 1.0, 5.0, "contradicts itself", "why").holds


@pytest.mark.parametrize("machine", machines_with_published_values())
def test_only_a_row_with_a_tolerance_is_called_reproduced(machine):
    for row in rows_of(machine):
        claimed = row.verdict in ("reproduced", "reproduced with a stated change")
        assert claimed == row.gated, row.quantity
        assert row.gated == (row.tolerance is not None)


def test_a_row_without_a_tolerance_cannot_claim_to_be_reproduced():
    with pytest.raises(ValueError, match="without a tolerance"):
        Literature("a", "b", "c").reported("x", 2.0, 2.1, "reproduced", "why")
