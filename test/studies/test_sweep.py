# SPDX-License-Identifier: Apache-2.0
"""A sweep: every point once, whoever computes it and however often it is interrupted."""

import csv
import math
from pathlib import Path

import pytest
from pyarrow import parquet

from mech_twin.capabilities.plots import sheet
from mech_twin.errors import StudyError
from mech_twin.parameters.errors import key_units
from mech_twin.parameters.load import machine, machine_parameters
from mech_twin.studies import sweep, sweep_table
from mech_twin.studies.parameter_sweep import SweepJournal, journal_of
from mech_twin.studies.spreading import spread
from mech_twin.studies.sweep_table import Point, Question, question, write_picture

pytestmark = pytest.mark.slow

AXES = {"eccentricity_m": (0.0, 0.002, 0.004, 0.006), "yarn_speed_m_per_s": (4.0, 5.0, 6.0)}


def test_points_are_the_machine_s_own_numbers_in_the_order_of_the_grid(tmp_path):
    done = sweep("winding_drum", AXES, tmp_path / "drum.parquet", cores=1)
    table = parquet.read_table(done.table).to_pydict()
    assert table["eccentricity_m"] == [e for e in AXES["eccentricity_m"] for _ in range(3)]
    assert table["yarn_speed_m_per_s"] == list(AXES["yarn_speed_m_per_s"]) * 4
    overrides = {"eccentricity_m": 0.006, "yarn_speed_m_per_s": 4.0}
    report = machine("winding_drum", overrides=overrides).report()
    assert {name: table[name][9] for name in report} == report
    assert done.picture is not None
    assert done.picture.stat().st_size > 5000
    assert not journal_of(done.table).exists()


def test_an_interrupted_sweep_goes_on_without_repeating_a_point(tmp_path):
    table, seen = tmp_path / "drum.csv", []

    def interrupt(done: int, _all: int) -> None:
        seen.append(done)
        if done >= 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep("winding_drum", AXES, table, cores=1, picture=False, progress=interrupt)
    journal = journal_of(table)
    kept = journal.read_text().splitlines()[1:]
    journal.write_bytes(journal.read_bytes() + b'{"index": 11, "numb')  # cut off in the middle of a line
    counted = []
    done = sweep("winding_drum", AXES, table, cores=1, picture=False, progress=lambda n, _all: counted.append(n))
    assert done.resumed == counted[0] == len(kept) == seen[-1]
    assert counted == sorted(set(counted))
    whole = sweep("winding_drum", AXES, tmp_path / "whole.csv", cores=1, picture=False)
    assert [point.numbers for point in done.points] == [point.numbers for point in whole.points]
    with table.open() as stream:
        assert len(list(csv.reader(stream))) == 13


def test_a_point_reported_twice_counts_once(tmp_path):
    asked = question("winding_drum", machine_parameters("winding_drum"), {"eccentricity_m": (0.0, 0.001)})
    from mech_twin.studies.sweep_table import points

    journal = SweepJournal(tmp_path / "j", asked)
    assert journal.add(points(asked, [0, 1])) == 2
    assert journal.add(points(asked, [1])) == 0
    journal.close()
    assert len((tmp_path / "j").read_text().splitlines()) == 3


def test_a_journal_of_another_sweep_is_not_mixed_in(tmp_path):
    parameters = machine_parameters("winding_drum")
    asked = question("winding_drum", parameters, {"eccentricity_m": (0.0, 0.001)})
    SweepJournal(tmp_path / "j", asked).close()
    other = question("winding_drum", parameters, {"eccentricity_m": (0.0, 0.002)})
    with pytest.raises(StudyError, match="another sweep"):
        SweepJournal(tmp_path / "j", other)


def test_a_point_whose_motion_cannot_be_followed_says_why_and_the_others_stand(tmp_path):
    key, rates = "springs.spring.rate_n_per_m", (8000.0, 1e12)  # the second presses an elastic ram onto its anvil
    page, installed = tmp_path / "hammer.yaml", Path(__file__).parents[2] / "config" / "pages" / "spring_hammer.yaml"
    page.write_text(installed.read_text(encoding="utf-8").replace("restitution: 0.3", "restitution: 1.0"), "utf-8")
    done = sweep(str(page), {key: rates}, tmp_path / "hammer.csv", duration_s=0.1, cores=1, picture=False)
    assert [bool(point.refused) for point in done.points] == [False, True]
    assert "more events in a coupling step" in done.points[1].refused


def test_a_refused_point_says_why_and_the_others_stand(tmp_path):
    axes = {"linkage.crank_m": (0.06, 5.0)}
    done = sweep("compaction_press", axes, tmp_path / "p.parquet", outputs=("stroke_m",), cores=1, picture=False)
    assert done.points[0].numbers["stroke_m"] == pytest.approx(0.0602178, abs=1e-6)
    assert "point" in done.points[1].refused
    assert math.isnan(parquet.read_table(done.table)["stroke_m"][1].as_py())


@pytest.mark.parametrize("rods", [(0.4, 0.5, math.inf), (0.5, 0.4, 0.6), (0.4, 0.5, None)])
def test_any_values_of_two_keys_are_drawn_as_a_map(tmp_path, rods):
    """What has no place on an axis, or is out of order, stands at even places."""
    axes = {"rod_m" if None not in rods else "masses.rotating_kg": rods, "crank_m": (0.08, 0.1)}
    done = sweep("vibration_crank", axes, tmp_path / "m.csv", outputs=("drive_torque_peak_nm",), cores=1)
    assert done.picture is not None and done.picture.stat().st_size > 5000


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Return a function that draws a sweep of these axes, whose number is the sum, and returns figure and panel."""
    made = []
    monkeypatch.setattr(sweep_table, "sheet", lambda *size: made.append(sheet(*size)) or made[-1])

    def draw(**axes):
        asked = Question("m", {}, tuple(axes.items()), (), 0.0)
        found = [Point(i, {"sum": sum(asked.changes(i).values())}, "") for i in range(asked.count)]
        assert write_picture(asked, found, tmp_path / "m.png")
        return made[-1][0], made[-1][1][0]

    return draw


EVEN, DECADES = (100.0, 200.0, 300.0, 1000.0, 1100.0), (1.0, 10.0, 20.0, 100.0)


def test_values_spread_over_decades_stand_on_a_logarithmic_axis(drawn):
    assert drawn(a=DECADES)[1].get_xscale() == "log"
    for values in (EVEN, (0.0, *DECADES), (2.0, 4.0, 8.0)):
        assert drawn(a=values)[1].get_xscale() == "linear"
    (mesh, *_) = drawn(down=DECADES, across=EVEN)[1].collections
    across, down = mesh.get_coordinates()[0, :, 0], mesh.get_coordinates()[:, 0, 1]
    assert list(across) == pytest.approx([50.0, 150.0, 250.0, 650.0, 1050.0, 1150.0])
    assert list(down) == pytest.approx([10.0**-0.5, 10.0**0.5, 200.0**0.5, 2000.0**0.5, 5.0**0.5 * 100.0])


def test_a_key_of_one_value_stands_in_the_title_and_the_others_are_drawn(drawn):
    figure, panel = drawn(held=(3.0,), a=EVEN)
    assert (figure.get_suptitle(), panel.get_xlabel()) == ("m: 5 points, held = 3.0", "a")
    assert list(panel.lines[0].get_ydata()) == pytest.approx([3.0 + value for value in EVEN])


@pytest.mark.parametrize("axes", [{"a": ("x", "y")}, {"a": ("x", "y"), "b": EVEN}, {"b": EVEN, "a": ("y", "x")}])
def test_a_key_of_words_is_drawn(tmp_path, axes):
    asked = Question("m", {}, tuple(axes.items()), (), 0.0)
    assert write_picture(asked, [Point(i, {"sum": 2.0**i}, "") for i in range(asked.count)], tmp_path / "m.png")


def test_two_processes_give_what_one_gives(tmp_path):
    asked = question("winding_drum", machine_parameters("winding_drum"), AXES, ("dynamic_torque_nm",))
    from functools import partial

    from mech_twin.studies.sweep_table import points

    task, batches = partial(points, asked), [[i, i + 1] for i in range(0, 12, 2)]
    together = sorted((p for found in spread(task, batches, 2) for p in found), key=lambda p: p.index)
    assert together == [p for found in spread(task, batches, 1) for p in found]


@pytest.mark.parametrize(
    ("axes", "outputs", "words"),
    [
        ({"eccentricity": (1.0,)}, (), "did you mean 'eccentricity_m'"),
        ({"eccentricity_m": ()}, (), "no values"),
        ({"eccentricity_m": (0.001,)}, ("dynamic_torque",), "did you mean dynamic_torque_nm"),
    ],
)
def test_a_wrong_question_is_told_before_anything_is_computed(tmp_path, axes, outputs, words):
    with pytest.raises(StudyError, match=words):
        sweep("winding_drum", axes, tmp_path / "x.parquet", outputs=outputs)
    assert list(tmp_path.iterdir()) == []


def test_every_number_of_a_grid_is_reached_once():
    asked = Question("m", {}, (("a", (1, 2)), ("b", (3, 4, 5)), ("c", ("x", "y"))), (), 0.0)
    assert len({tuple(asked.changes(i).values()) for i in range(asked.count)}) == asked.count == 12
    assert list(asked.changes(7)) == ["a", "b", "c"]


def test_optional_groups_are_keys_too():
    keys = key_units(type(machine_parameters("compaction_press")))
    assert {"linkage.crank_m", "motor.rated_power_w", "gear.ratio"} <= set(keys)
