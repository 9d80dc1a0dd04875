# SPDX-License-Identifier: Apache-2.0
"""The functions of ``import mech_twin as mt``: what they return is what the rooms below give, with units."""

import csv
import pickle
import re
import subprocess
import sys
from inspect import signature
from pathlib import Path

import numpy as np
import pytest
from command_line import mech_twin
from hypothesis import given, settings
from hypothesis import strategies as st

import mech_twin as mt
from mech_twin import studies
from mech_twin.declarations.captions import unit_of
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import Trajectory
from mech_twin.errors import MeasurementError, StudyError
from mech_twin.files.output_file import OutputError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine as built_machine
from mech_twin.recording.errors import DamagedBagError
from mech_twin.results.objects import Columns
from mech_twin.studies.design_scan import design_question

BAG_MAP = Path(__file__).parents[1] / "bags/weak_spring/map.yaml"


def test_importing_the_package_loads_neither_machines_nor_ros():
    asked = "import sys, mech_twin; print(sorted({'numba', 'scipy', 'rclpy', 'matplotlib'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.parametrize("name", CATALOGUE)
def test_samples_of_a_run_are_those_of_the_engine(name):
    machine = built_machine(name)
    expected = Trajectory()
    for frame in frames(machine, 0.02):
        expected.append(frame)
    run = mt.simulate(name, 0.02)
    assert {key: column.tolist() for key, column in run.samples.items()} == expected.columns()
    assert run.parameters == machine.parameters
    assert run.sound


def test_settings_change_the_machine_that_runs():
    usual, changed = (
        mt.simulate("mb10_breaker", 0.0),
        mt.simulate("mb10_breaker", 0.0, {"motor.rated_speed_rpm": 1410.0}),
    )
    assert changed.parameters.motor.rated_speed_rpm == 1410.0
    assert changed.summary["rated_crank_speed_rad_per_s"] < usual.summary["rated_crank_speed_rad_per_s"]


def test_a_wrong_key_is_refused_by_name():
    with pytest.raises(ConfigurationError, match=r"spring_rat\b"):
        mt.simulate("mb10_breaker", 0.0, {"body.spring_rat": 1.0})


@pytest.mark.parametrize("duration", [-1.0, float("nan"), float("inf")])
def test_an_impossible_duration_is_refused(duration):
    with pytest.raises(StudyError, match="duration_s"):
        mt.simulate("mb10_breaker", duration)


def test_a_run_can_be_recorded_and_is_not_overwritten_unasked(tmp_path, ros_domain):
    from mech_twin.recording.bag_reader import bag_info

    mt.simulate("compaction_press", 0.02, bag=tmp_path / "bag")
    assert bag_info(tmp_path / "bag").finished
    with pytest.raises(Exception, match="bag"):
        mt.simulate("compaction_press", 0.02, bag=tmp_path / "bag")


def test_columns_cannot_be_changed():
    run = mt.simulate("compaction_press", 0.01)
    with pytest.raises(ValueError, match="read-only"):
        run.samples["time_s"][0] = 1.0


def test_a_missing_column_is_named_with_its_neighbours():
    run = mt.simulate("compaction_press", 0.0)
    with pytest.raises(KeyError, match="time_s"):
        run.samples["times"]


def test_units_are_those_the_names_end_in():
    assert unit_of("forces.drive_torque_nm") == "N m"
    assert unit_of("rated_crank_speed_rad_per_s") == "rad/s"
    assert unit_of("linkage.crank.position") == ""  # of the machine, not of the name
    assert unit_of("rated_slip") == ""


@pytest.mark.slow
@settings(deadline=None, max_examples=20)
@given(st.lists(st.floats(allow_nan=False), min_size=1, max_size=20))
def test_tables_hold_the_same_bits(values):
    columns = Columns("trial", "time_s", {"time_s": range(len(values)), "force_n": values})
    table, frame = columns.to_arrow(), columns.to_pandas()
    assert table.column("force_n").to_numpy().tobytes() == columns["force_n"].tobytes()
    assert table.schema.field("force_n").metadata == {b"unit": b"N"}
    assert frame["force_n"].to_numpy(dtype=np.float64).tobytes() == columns["force_n"].tobytes()
    assert frame.attrs["units"]["force_n"] == "N"


@pytest.mark.slow
def test_a_picture_has_one_unit_in_a_panel():
    run = mt.simulate("compaction_press", 0.05)
    figure = run.plot("forces.drive_torque_nm", "linkage.crank.velocity", "motor.motor.velocity")
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["drive torque [N m]", "rad/s"]
    assert [len(axes.lines) for axes in figure.axes] == [1, 2]
    assert figure.axes[-1].get_xlabel() == "time [s]"


@pytest.mark.parametrize("name", CATALOGUE)
def test_every_joint_of_a_run_has_the_unit_of_what_slides_or_turns(name):
    from mech_twin.measurements.units import sliding_in

    units, sliding = mt.simulate(name, 0.0).samples.units, sliding_in(built_machine(name))
    for joint in built_machine(name).linkage.joints:
        expected = ["m", "m/s", "N"] if joint in sliding else ["rad", "rad/s", "N m"]
        assert [units[f"linkage.{joint}.{field}"] for field in ("position", "velocity", "effort")] == expected


def test_every_axis_of_a_comparison_has_a_unit():
    runs = [mt.simulate("vibration_crank", 0.1, {"crank_m": length}) for length in (0.12, 0.13)]
    axes = mt.compare(*runs).plot(40).axes
    pure = [one.get_ylabel() for one in axes if not one.get_ylabel().endswith("]")]
    assert len(axes) > 10
    assert not [label for label in pure if "position" in label or "velocity" in label or "effort" in label]


def test_points_of_a_grid_are_joined_by_no_line():
    spots, shared = Columns("trial", "a", {"a": [1, 2], "y": [3, 4]}), Columns("trial", "a", {"a": [1, 1], "y": [3, 4]})
    assert [each.plot().axes[0].lines[0].get_linestyle() for each in (spots, shared)] == ["-", "None"]


def test_nothing_that_varies_gives_no_picture():
    with pytest.raises(ValueError, match="no column that varies"):
        Columns("trial", "time_s", {"time_s": [0.0, 1.0], "force_n": [2.0, 2.0]}).plot()


def test_the_analysis_is_the_machines_own():
    found, machine = mt.analyse("compaction_press", positions=4), built_machine("compaction_press")
    assert dict(found.summary) == machine.report()
    assert found.cycle["crank_rad"].tolist() == pytest.approx([0.0, np.pi / 2, np.pi, 1.5 * np.pi])
    assert found.cycle["drive_torque_nm"][1] == machine.analyse(np.pi / 2)["drive_torque_nm"]


def test_a_sweep_holds_what_each_point_gives_alone():
    keys = {"motor.rated_speed_rpm": [1410.0, 1430.0], "motor.rated_power_w": [1500.0]}
    table = mt.sweep("mb10_breaker", keys, outputs=["rated_torque_nm"], cores=1)
    alone = [mt.analyse("mb10_breaker", {"motor.rated_speed_rpm": speed}, positions=1) for speed in (1410.0, 1430.0)]
    assert table["rated_torque_nm"].tolist() == [found.summary["rated_torque_nm"] for found in alone]
    assert table["refused"].tolist() == ["", ""]


def test_a_sweep_is_the_table_that_the_study_writes(tmp_path):
    from mech_twin.studies import sweep

    keys = {"motor.rated_speed_rpm": [1410.0, 1430.0]}
    done = sweep("mb10_breaker", keys, tmp_path / "points.csv", picture=False, cores=1)
    table = mt.sweep("mb10_breaker", keys, cores=1)
    with done.table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == list(table)
    assert [float(row["rated_torque_nm"]) for row in rows] == table["rated_torque_nm"].tolist()


@pytest.mark.slow
def test_sizes_and_published_rows_are_those_of_the_studies():
    from mech_twin.studies import reproduce, size

    assert mt.size("compaction_press").sizes == size("compaction_press").sizes
    assert mt.reproduce("vibration_crank") == reproduce("vibration_crank")
    with pytest.raises(StudyError, match="name of a machine"):
        mt.reproduce(settings={"motor.rated_speed_rpm": 900.0})


@pytest.mark.slow
def test_the_examples_of_the_documentation_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    root = Path(__file__).parents[1]
    pages = [(root / name).read_text(encoding="utf-8") for name in ("docs/python.md", "README.md")]
    blocks = [block for page in pages for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL)]
    for block in (block for block in blocks if "import mech_twin" in block):
        exec(compile(block, "documentation", "exec"), {})
    assert {path.name for path in tmp_path.iterdir()} == {"run.png", "torque.png"}
    assert " N\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (lambda: mt.simulate("mb10_braker", 0.0), "did you mean 'mb10_breaker'"),
        (lambda: mt.simulate(3, 0.0), "no machine 3"),
        (lambda: mt.simulate(np.array([1.0, 2.0]), 0.0), "no machine array([1., 2.])"),
        (lambda: mt.simulate("mb10_breaker", "3s"), "duration_s '3s': expected a finite number of seconds"),
        (lambda: mt.simulate("mb10_breaker", 0.0, ["a=1"]), "settings ['a=1']: expected settings by dotted key"),
        (lambda: mt.simulate("mb10_breaker", 0.0, config=3), "config 3: expected the path of a file"),
        (lambda: mt.simulate("mb10_breaker", 0.0).samples["linkage.crnk.position"], "mean linkage.crank.position"),
        (lambda: mt.simulate("mb10_breaker", 0.0).plot(["time_s"]), "expected names of columns"),
        (lambda: mt.analyse("mb10_breaker", positions="a"), "positions: expected a whole number"),
        (
            lambda: mt.sweep("mb10_breaker", {"body.preload_deflection_m": 0.01}),
            "value 0.01: expected a list of",
        ),
        (lambda: mt.sweep("mb10_breaker", {"body.preload_deflection_m": "0:1:3"}), "value '0:1:3': expected a list"),
        (lambda: mt.sweep("mb10_breaker", {"body.preload_deflection_m": [1.0]}, outputs="x"), "outputs 'x': expected"),
        (lambda: mt.sweep("mb10_breaker", {"body.preload_deflection_m": [1.0]}, outputs=[1]), "no summary number 1"),
        (lambda: mt.sweep("winding_drum", np.eye(2)), "axes array"),
        (
            lambda: mt.sweep("winding_drum", {"eccentricity_m": [True, 0.001]}),
            "values True and 0.001: expected numbers or names, not both",
        ),
        (
            lambda: studies.search_runs("vibration_crank", "run_power_max_w", {"rod_m": (0.4, 0.5)}),
            "without a run: no objective 'run_power_max_w'",
        ),
        (
            lambda: studies.search_runs("vibration_crank", "drive_torque_peak_nm", {"masses.pin_kg": (0.0, 1.0)}),
            "drive_torque_peak_nm is the same at all 16 points tried: masses.pin_kg changes nothing",
        ),
        (lambda: mt.simulate("winding_drum", 0.0, bag=3), "bag 3: expected the path of a file"),
        (lambda: mt.simulate("winding_drum", 0.0, {"core_radius_m": b"0.1"}), "value b'0.1': expected a number in m"),
        (lambda: mt.size("compaction_press", limits={"non_uniformty": 1}), "did you mean non_uniformity"),
        (lambda: mt.size("compaction_press", limits={"non_uniformity": float("nan")}), "non_uniformity nan: expected"),
        (lambda: mt.size("compaction_press", tolerance="5 %"), "tolerance '5 %': expected 0 to 0.5"),
        (lambda: mt.compare("a", "b"), "'a': expected two runs as `simulate` returns them"),
        (lambda: mt.identify("vibration_crank", "plant.csv", "map.yaml"), "runs 'plant.csv': expected a list of paths"),
        (lambda: mt.identify("mb10_breaker", [], BAG_MAP, ["tool.restitution"]), "runs: expected at least"),
        (lambda: mt.rollout("winding_drum", duration_s="1"), "duration_s '1': expected"),
        (lambda: mt.rollout("winding_drum", duration_s=1e12), "duration_s 1000000000000.0: expected"),
        (lambda: mt.rollouts("winding_drum", 0.1, [None], cores=0), "cores: expected a whole number from 1 to"),
        (lambda: mt.sweep("mb10_breaker", {"body.preload_deflection_m": [0.01]}, cores=0), "cores: expected a whole"),
        (lambda: studies.designs("compaction_press", 100, cores=0), "cores: expected a whole number from 1 to"),
        (lambda: studies.designs("compaction_press", 0), "count: expected a whole number from 1 to"),
        (lambda: mt.search("compaction_press", bounds={"crank": 0.05}), "bounds of crank 0.05: expected a lower"),
        (lambda: mt.search("compaction_press", limits={"stroke_m": "a"}), "limit stroke_m 'a': expected"),
        (lambda: mt.search("compaction_press", seed=-1), "seed: expected a whole number"),
        (lambda: studies.search_runs("winding_drum", "x", {"core_radius_m": 1}), "bounds of core_radius_m 1: expected"),
        (lambda: mt.search("winding_drum"), "winding_drum: no design question; `mech_twin.studies.search_runs` finds"),
        (
            lambda: studies.search_runs("roller_former", "x", {"carts.count": (1.0, 4.0)}),
            "bounds of carts.count: 2 is a choice or a count; expected a key of real numbers",
        ),
        (lambda: studies.synthesise("impact_mass", 1e-9), "key 'period_s', value 4333333333.333333: input should be"),
        (lambda: studies.synthesise("impact_mass", 2.0, options={"margn": 1}), "no option 'margn'; expected one of"),
        (lambda: studies.regimes("impact_mass", [10.0]), "phase1_duration_s = 10.0, period_s = 0.05"),
        (lambda: studies.regimes("impact_mass", ["a"]), "value of phase1_duration_s 'a': expected a finite number"),
        (lambda: mt.rollouts("winding_drum", 0.0, [None])["linkage.drm.velocity"], "linkage.drum.velocity"),
        (lambda: mt.rollouts("winding_drum", 0.0, [None])[0], "0: expected the name of a column; a member is one of"),
        (lambda: mt.from_json(None), "document None: expected the path of a file"),
        (
            lambda: Columns("run", "time_s", {"time_s": []}).plot("time_s"),
            "no rows; JSON output holds those of a run with --samples",
        ),
        (
            lambda: mt.simulate("winding_drum", 0.0, {"friction.coulomb_nm": 1.0, "friction": {"coulomb_nm": 2.0}}),
            "key 'friction.coulomb_nm' stands twice",
        ),
        (
            lambda: mt.simulate("winding_drum", 0.0, {"friction.coulomb_nm": 1.0, "friction": 2.0}),
            "key 'friction' stands twice, or as a value and a group",
        ),
        (lambda: mt.rollout("winding_drum", 0.1, ["a"]), "settings ['a']: expected settings by dotted key"),
        (lambda: mt.rollout("winding_drum", {"core_radius_m": 0.1}), "duration_s {'core_radius_m': 0.1}: expected"),
        (lambda: mt.rollouts("winding_drum", 0.1, "core"), "settings 'core': expected a list of settings"),
        (lambda: mt.rollout("winding_drum", duration_s=0.1, columns=["linkage.drm.velocity"]), "linkage.drum.velocity"),
        (lambda: mt.rollout("winding_drum", duration_s=0.1)["linkage.drm.velocity"], "linkage.drum.velocity"),
        (lambda: mt.rollout("winding_drum", duration_s=0.1, command="half"), "command 'half': expected a number"),
        (lambda: mt.rollout("winding_drum", duration_s=0.1, changes=[(float("nan"), {})]), "change at nan: expected"),
        (
            lambda: mt.rollout("winding_drum", duration_s=0.1, changes=[(0.2, {"yarn_speed_m_per_s": 1.0})]),
            "change at 0.2 s: expected up to the end of the run at 0.1 s",
        ),
        (
            lambda: mt.rollout("winding_drum", duration_s=0.1, start=mt.rollout("impact_mass", duration_s=0.0).final),
            "expected one of winding_drum",
        ),
    ],
)
def test_a_strange_argument_is_refused_in_one_line_by_an_error_of_our_own(asked, said):
    with pytest.raises((StudyError, ConfigurationError)) as refused:
        asked()
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


def test_values_of_a_sweep_may_be_an_array():
    found = mt.sweep("mb10_breaker", {"body.preload_deflection_m": np.linspace(0.01, 0.014, 3)}, cores=1)
    assert found["body.preload_deflection_m"].tolist() == np.linspace(0.01, 0.014, 3).tolist()


def test_a_number_in_single_precision_is_the_number_that_it_holds():
    def numbers(kind):
        sized = mt.size("compaction_press", limits={"non_uniformity": kind(0.0625)}, tolerance=kind(0.0625))
        values = studies.regimes("impact_mass", [kind(0.03125)], settling_periods=5).rows
        space = design_question("compaction_press").space(limits={"stroke_m": kind(0.125)})
        return sized.sizes, sized.tolerance, values, space

    assert repr(numbers(np.float32)) == repr(numbers(float))


def test_a_roll_out_is_a_table_with_units_and_takes_settings():
    run = mt.rollout("mb10_breaker", 0.01, {"body.preload_deflection_m": 0.012})
    as_run = mt.simulate("mb10_breaker", 0.01, {"body.preload_deflection_m": 0.012}).samples
    assert {name: run.samples.units[name] for name in as_run} == as_run.units
    assert run.units == run.samples.units
    assert all(run[name].tobytes() == as_run[name].astype(float).tobytes() for name in as_run)
    assert run.to_pandas()["time_s"].tolist() == run["time_s"].tolist()
    assert run.plot("linkage.crank.velocity").axes[0].get_ylabel() == "crank velocity [rad/s]"
    assert repr(run).startswith("mb10_breaker: 0.01 s: 11 rows of time_s, ")


def test_every_result_with_columns_is_a_data_frame():
    run, cycle = mt.simulate("winding_drum", 0.01), mt.analyse("vibration_crank", positions=4)
    assert run.to_pandas().equals(run.samples.to_pandas())
    assert cycle.to_pandas().equals(cycle.cycle.to_pandas())
    assert run.to_arrow().column_names == list(run.samples)
    assert cycle.to_arrow().column_names == list(cycle.cycle)
    both = mt.rollouts("winding_drum", 0.01, [None, None])
    assert both.to_pandas().loc[1].reset_index(drop=True).equals(both.members[1].to_pandas())


@pytest.mark.parametrize(("name", "chosen"), [("impact_mass", {"stop.model": "wave"}), ("vibration_crank", {})])
def test_roll_outs_come_whole_from_another_process(name, chosen):
    found = mt.rollouts(name, 0.2, [chosen, chosen])
    come = pickle.loads(pickle.dumps(found))
    for before, after in zip(found, come, strict=True):
        assert all(before[column].tobytes() == after[column].tobytes() for column in before.columns)
        assert (after.stepped_events, after.final) == (before.stepped_events, before.final)
        assert [part.tolist() for part in after.event_numbers] == [part.tolist() for part in before.event_numbers]
        assert [(last, one.parameters) for last, one in after.machines] == [
            (last, one.parameters) for last, one in before.machines
        ]
    if chosen:
        peaks = [run.gauge_numbers("impact", "peak_strain").tolist() for run in (found.members[0], come.members[0])]
        assert peaks[0] == peaks[1]
        assert peaks[0]


@pytest.mark.parametrize(
    "error", [MeasurementError("a.csv", "no row"), DamagedBagError("bag", "torn"), OutputError(Path("a"), "full")]
)
def test_errors_come_whole_from_another_process(error):
    come = pickle.loads(pickle.dumps(error))
    assert (type(come), str(come), vars(come)) == (type(error), str(error), vars(error))


def test_a_frame_without_pandas_names_the_extra(monkeypatch):
    monkeypatch.setattr("mech_twin.process.dependencies.find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError, match="needs the extra 'pandas': pip install"):
        Columns("trial", "time_s", {"time_s": [0.0]}).to_pandas()


@pytest.mark.parametrize("function", [mt.rollout, mt.rollouts])
def test_a_roll_out_is_asked_for_like_a_run(function):
    first = list(signature(mt.simulate).parameters)[:3]
    assert list(signature(function).parameters)[:3] == first == ["machine", "duration_s", "settings"]


def test_what_is_shown_of_a_result_fits_a_terminal():
    sizes, run = mt.size("compaction_press"), mt.simulate("compaction_press", 0.01)
    for result in (sizes, run, mt.compare(run, run), mt.analyse("compaction_press", positions=4)):
        assert "CompactionPress(" not in repr(result)
    assert "flywheel.inertia_kg_m2" in repr(sizes)
    assert sizes.to_pandas().loc["flywheel.inertia_kg_m2", "unit"] == "kg m²"
    assert mt.compare(run, run).to_pandas()["relative"].max() == 0.0


def test_two_runs_are_compared_and_drawn_side_by_side() -> None:
    short = mt.simulate("compaction_press", 0.02)
    longer_crank = mt.simulate("compaction_press", 0.02, {"linkage.crank_m": 0.05})
    found = mt.compare(short, longer_crank)
    assert [setting.name for setting in found.found.settings] == ["linkage.crank_m"]
    assert found.found.beyond
    assert found.plot().axes
    same = mt.compare(short, short)
    assert not same.found.settings
    assert not same.found.beyond
    with pytest.raises(StudyError, match="no column differs"):
        same.plot()
    with pytest.raises(StudyError, match="expected one machine"):
        mt.compare(short, mt.simulate("winding_drum", 0.01))


def test_a_run_that_ends_before_its_numbers_count_says_so() -> None:
    page = str(Path(__file__).parents[1] / "config/pages/four_bar.yaml")
    line = "settle_s = 0.5 s: the run is not longer, so it has no numbers"
    assert [mt.simulate(page, seconds, {"settle_s": 0.5}).remarks for seconds in (0.4, 0.6)] == [(line,), ()]


def test_a_page_is_a_path_or_its_text(tmp_path: Path) -> None:
    file = tmp_path / "fall.yaml"
    file.write_text("bodies: {m: {mass_kg: 1}}\njoints: {s: {kind: slider, between: [ground, m]}}\n", encoding="utf-8")
    assert mt.simulate(file, 0.01).summary == mt.simulate(str(file), 0.01).summary
    swept = [mt.sweep(page, {"bodies.m.mass_kg": [1.0, 2.0]}, cores=1) for page in (file, str(file))]
    assert repr(swept[0]) == repr(swept[1])


@pytest.mark.slow
def test_what_is_shown_of_a_page_names_it(tmp_path: Path) -> None:
    page = str(Path(__file__).parents[1] / "config/pages/slider_crank.yaml")
    words = {"simulate": ["--duration", "0.01", "--one-step"], "analyse": [], "study": ["sweep", "--no-picture"]}
    words["study"] += ["--over", "drives.motor.speed_rpm=1,2", "--out", str(tmp_path / "sweep.csv")]
    shown = [mt.size(page), mt.sweep(page, {"drives.motor.speed_rpm": [1.0, 2.0]}), mt.analyse(page)]
    run = mt.simulate(page, 0.01)
    shown += [run, mt.compare(run, run), mt.rollout(page, 0.01)]
    for verb, options in words.items():
        document = mech_twin(verb, page, *options, "--json").out
        (tmp_path / "document.json").write_text(document, encoding="utf-8")
        shown.append(mt.from_json(tmp_path / "document.json"))
    assert {re.split(r"\W", repr(each))[0] for each in shown} == {"slider_crank"}


def test_settings_by_group_and_by_dotted_key_count_together_and_stay_as_they_are():
    settings = {"friction": {"coulomb_nm": 0.5}, "friction.viscous_nms_per_rad": 0.25}
    friction = mt.simulate("winding_drum", 0.0, settings).parameters.friction
    assert (friction.coulomb_nm, friction.viscous_nms_per_rad) == (0.5, 0.25)
    assert settings == {"friction": {"coulomb_nm": 0.5}, "friction.viscous_nms_per_rad": 0.25}
    assert mt.simulate("winding_drum", 0.0, dict(reversed(settings.items()))).parameters.friction == friction
