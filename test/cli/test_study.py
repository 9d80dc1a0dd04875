# SPDX-License-Identifier: Apache-2.0
"""``mech-twin study``: the questions as they are asked on the command line."""

import json

import pytest
import yaml
from command_line import mech_twin

from mech_twin.capabilities.progress import listening, tell
from mech_twin.cli.console import CommandError
from mech_twin.cli.study import axes_of, limits_of
from mech_twin.parameters.load import machine

pytestmark = pytest.mark.slow


@pytest.fixture
def asked(tmp_path, monkeypatch):
    """Return what asks a question in a directory of the test's own."""
    monkeypatch.chdir(tmp_path)
    return lambda *words: mech_twin("study", *words)


def test_ranges_lists_and_logarithms_are_read():
    assert axes_of(["a.b=1:2:3", "c=1,x,true"]) == {"a.b": (1.0, 1.5, 2.0), "c": (1, "x", True)}
    assert axes_of(["k=1:100:3:log"])["k"] == pytest.approx((1.0, 10.0, 100.0))
    assert limits_of(["a=1e-3"]) == {"a": 0.001}


@pytest.mark.parametrize(
    "text", ["a", "=1", "a=", "a=1:2", "a=1:2:0", "a=0:2:3:log", "a=1:nan:3", "a=1:2:3:ln", "a={b: 1}"]
)
def test_an_axis_that_cannot_be_read_is_refused(text):
    with pytest.raises(CommandError, match="--over"):
        axes_of([text])


def test_a_sweep_is_written_and_told_as_json(asked, tmp_path):
    words = ("winding_drum", "sweep", "--over", "eccentricity_m=0.0,0.004", "--out", "d.csv", "--json")
    done = asked(*words)
    assert done.code == 0, done.err
    document = json.loads(done.out)
    report = machine("winding_drum").report()
    assert {name: document["rows"][1][name] for name in report} == pytest.approx(report)
    assert (tmp_path / "d.csv").is_file()
    assert (tmp_path / "d.png").is_file()


def test_a_number_that_one_point_lacks_is_not_called_refused(asked):
    """A motor that stalls has no steady turn; the configuration is not refused."""
    done = asked("roller_former", "sweep", "--over", "parameter_set=table,printed", "--out", "d.csv", "--all")
    assert done.code == 0, done.err
    assert "refused" not in done.out + done.err
    assert " - " in done.out


def test_what_a_sweep_refused_is_counted_and_the_first_reason_told(asked):
    done = asked("winding_drum", "sweep", "--over", "eccentricity_m=0.004,0.09")
    assert "points refused: 1, the first: this point: eccentricity_m <= " in done.err


def test_sizes_are_written_as_a_configuration_that_runs(asked, tmp_path):
    done = asked("vibration_crank", "size", "--limit", "counterweight_mass_kg=45", "--tolerance", "0", "--json")
    assert done.code == 0, done.err
    assert "counterweight_mass_kg <= 45" in json.loads(done.out)["binding"]
    built = machine("vibration_crank", tmp_path / "vibration_crank-sized.yaml")
    assert built.report()["counterweight_mass_kg"] == pytest.approx(45.0, rel=1e-3)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("nothing", "sweep", "--over", "a=1,2"), "no machine 'nothing'"),
        (("winding_drum", "sweep", "--over", "a=1,2"), "no configuration key 'a'"),
        (("vibration_crank", "sweep", "--over", "rod_m=0.5,a"), "values 0.5 and 'a': expected numbers or names, not"),
        (("vibration_crank", "size", "--tolerance", "0.6"), "expected 0 to 0.5"),
        (("mb10_breaker", "size", "--limit", "tool_mass_kg=9"), "no limit 'tool_mass_kg'; there are gap_at_blow_m"),
        (("winding_drum", "search"), "no design question; its runs are searched with"),
        (("impact_mass", "designs", "--count", "10"), "no design question; there is an answer for compaction_press"),
        (("compaction_press", "search", "--limit", "peak_n=1"), "no limit 'peak_n'"),
        (("compaction_press", "search", *2 * ("--objective", "mass_kg")), "objective 'mass_kg' stands twice"),
        (("compaction_press", "size", "--limit", "a=1", "a=2"), "--limit a=2: 'a' stands twice; expected it once"),
        (
            ("compaction_press", "designs", "--limit", "stroke_m=-1"),
            "limit stroke_m -1.0: expected a number of 0 or more",
        ),
        (("vibration_crank", "size", "--out", "no/where.yaml"), "cannot be written"),
        (("vibration_crank", "size", "--report", "a.yaml", "--out", "a.yaml"), "a.yaml: another option writes it"),
        (("impact_mass", "synthesise", "--impact-speed", "-1"), "impact_speed_m_per_s > 0"),
        (("impact_mass", "synthesise", "--periods", "1000000000000"), "periods: expected a whole number from 1 to"),
        (("impact_mass", "synthesise", "--starts", "1000000000000"), "starts: expected a whole number from 1 to"),
        (
            ("impact_mass", "regimes", "--over", "restitution=0.5", "--settling", "1000000000000"),
            "settling: expected a whole number from 1 to 100000",
        ),
        (("impact_mass", "regimes", "--over", "restitution=0.5,1.5"), "restitution"),
        (
            ("impact_mass", "regimes", "--over", "restitution=0.5,x"),
            "value of restitution 'x': expected a finite number",
        ),
    ],
)
def test_a_wrong_question_is_one_line_and_exit_code_2(asked, words, told):
    done = asked(*words)
    assert done.code == 2
    assert told in done.err
    assert done.err.count("\n") == 1


@pytest.mark.slow
def test_the_robust_cycle_is_written_and_holds(asked, tmp_path):
    done = asked("impact_mass", "synthesise", "--json")
    document = json.loads(done.out)
    assert [held["rests_in_period"] for held in document["published"]["endurance"][1:]] == [7, 8]
    assert all(held["held_periods"] == 1_000_000 for held in document["robust"]["endurance"])
    text = (tmp_path / "impact_mass-robust.yaml").read_text()
    written = yaml.safe_load(text)["/**"]["ros__parameters"]
    assert written["phase2_force_n"] == document["robust"]["config"]["phase2_force_n"]


@pytest.mark.slow
def test_the_press_that_is_printed_is_the_one_that_is_written_with_its_speed_and_force(asked, tmp_path):
    words = ("--set", "drive.speed_rpm=200.0", "--set", "working_force.peak_n=15000.0", "--json")
    done = asked("compaction_press", "search", *words)
    assert done.code == 0, done.err
    design = json.loads(done.out)["designs"][0]
    written = tmp_path / "compaction_press-found.yaml"
    assert "# objective: peak_torque_nm\n" in written.read_text()  # the usual one
    built = machine("compaction_press", written)
    assert built.parameters.drive.speed_rpm == 200.0
    assert built.parameters.working_force.peak_n == 15000.0
    report = built.report()
    assert max(report["drive_torque_peak_nm"], -report["drive_torque_min_nm"]) == pytest.approx(
        design["peak_torque_nm"], rel=1e-9
    )
    assert report["flywheel_inertia_kg_m2"] == pytest.approx(design["flywheel_inertia_kg_m2"], rel=1e-9)
    assert min(design["margins"].values()) >= 0.0
    assert report["gamma_margin_deg"] == pytest.approx(design["margins"]["gamma_max_deg"], abs=1e-9)


def test_what_is_told_reaches_whoever_listens_and_nobody_else() -> None:
    heard: list[tuple[int, int]] = []
    tell(1, 2)
    with listening(lambda done, total: heard.append((done, total))):
        tell(3, 2)
    tell(4, 5)
    assert heard == [(3, 3)]


@pytest.mark.parametrize(
    ("machine", "study", "names"),
    [
        ("mb10_breaker", "size", ("gap_at_blow_m", "flight_share")),
        ("compaction_press", "search", ("gamma_max_deg", "stroke_m")),
        ("compaction_press", "designs", ("gamma_max_deg", "stroke_m")),
    ],
)
def test_limits_are_listed_with_their_usual_values_and_nothing_is_computed(machine, study, names, asked, tmp_path):
    found = asked(machine, study, "--limit", "help", *(["--count", "1"] if study == "designs" else []))
    assert found.code == 0, found.err
    assert all(name in found.out for name in names)
    assert "no limit" not in found.err
    assert list(tmp_path.iterdir()) == []
