# SPDX-License-Identifier: Apache-2.0
import re

import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader
from rrd_tables import rrd_tables
from synthetic_four_bar import PINS, drawing, events, frame, metrics

from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import StepSamples, frame_events
from mech_twin.errors import RerunSceneError
from mech_twin.parameters.load import machine as built_machine
from mech_twin.samples import BodySample, Drawing, Event, Named, Shape
from mech_twin.view.annotations import Banner
from mech_twin.view.extent import Bounds, event_line, round_above
from mech_twin.view.layout import PhasePortrait, SceneContents, blueprint, legend_share, plot
from mech_twin.view.rerun_scene import RerunScene
from mech_twin.view.run_scene import KEPT_SAMPLES

STEPS = 1000


def shown(scene, steps=STEPS, *, with_body=True):
    """Show a synthetic run as a run's loop would."""
    for step in range(steps + 1):
        now = frame(step)
        scene.frame(now if with_body else now._replace(body=None))
        for event in events(step):
            scene.event(event)
        if scene.drawing_due(now.linkage.time_s):
            scene.drawing(drawing(step))
        if step % 1000 == 0:
            scene.metrics(metrics(step))


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    path = tmp_path_factory.mktemp("view") / "run.rrd"
    with RerunScene("four_bar", rrd_path=path) as scene:
        shown(scene)
    return rrd_tables(path)


@pytest.mark.parametrize("name", ["roller_former", "mb10_breaker"])
def test_a_joint_has_the_same_colour_in_every_plot_of_its_role(name, tmp_path):
    machine, path, colours = built_machine(name), tmp_path / "run.rrd", {}
    with RerunScene(name, rrd_path=path) as scene:
        scene.know(machine.mechanism)
        for now in frames(machine, 0.01):
            scene.frame(now)
    for entity, batch in rrd_tables(path)[1].items():
        if found := re.fullmatch(r"/(linkage|body)(?:_sliding)?/(?:position|speed|effort)", entity):
            names, drawn = (batch.column(f"SeriesLines:{column}")[0].as_py() for column in ("names", "colors"))
            for joint, colour in zip(names, drawn, strict=True):
                colours.setdefault((found[1], joint), set()).add(colour)
    assert colours
    assert all(len(of_joint) == 1 for of_joint in colours.values()), colours


def sorted_rows(table, component):
    rows = sorted(zip(table["step"].to_pylist(), table[component].to_pylist(), strict=True))
    return [row[0] for row in rows], np.array([row[1] for row in rows])


def test_curves_run_through_true_samples_and_keep_the_extremes_of_the_run(kept):
    steps, values = sorted_rows(kept[0]["/pins/magnitude"], "Scalars:scalars")
    full = np.array([[np.hypot(w.force_x_n, w.force_y_n) for w in frame(s).forces.wrenches] for s in range(STEPS + 1)])
    assert np.array_equal(values, full[steps])
    assert np.array_equal(values.max(axis=0), full.max(axis=0))
    assert np.array_equal(values.min(axis=0), full.min(axis=0))
    assert 2 * STEPS / 5 <= len(steps) < STEPS


def test_curves_carry_step_and_exact_simulation_time(kept):
    table = kept[0]["/motor/torque"]
    steps = np.array(table["step"].to_pylist())
    nanoseconds = np.array(table["sim_time"].cast(pa.int64()).to_pylist())
    assert np.array_equal(nanoseconds, steps * 1_000_000)
    assert {0, STEPS} >= {steps.min(), steps.max()}


def test_joints_and_pins_are_called_what_the_samples_call_them(kept):
    assert kept[1]["/pins/magnitude"].column("SeriesLines:names").to_pylist()[0] == list(PINS)
    assert kept[1]["/linkage/speed"].column("SeriesLines:names").to_pylist()[0] == ["crank", "coupler", "rocker"]


def test_the_mechanism_is_drawn_thirty_times_a_simulated_second(kept):
    moving, static = kept
    figure = moving["/mechanism/figure"]
    assert figure.num_rows == 31
    assert len(figure["LineStrips2D:strips"][0]) == 4
    assert len(figure["Points2D:positions"][0]) == 4
    assert len(figure["Arrows2D:vectors"][0]) == 1
    first = figure["LineStrips2D:strips"][0][1].as_py()
    assert np.allclose(first, drawing(0).shapes[1].points_m, atol=1e-7)
    assert "/mechanism" in static  # the mirror that turns the viewer's second axis up


def test_events_stand_at_their_own_exact_times(kept):
    happened = [event for step in range(STEPS + 1) for event in events(step)]
    table = kept[0]["/events"]
    assert table.num_rows == len(happened)
    at = np.array(table["sim_time"].cast(pa.int64()).to_pylist())
    assert np.array_equal(np.sort(at), np.round(np.array([event.time_s for event in happened]) * 1e9))


def test_a_blow_is_a_vertical_mark_at_its_exact_time(kept):
    blows = [event for step in range(STEPS + 1) for event in events(step) if event.contact == "tool"]
    table = kept[0]["/impacts/impulse/tool"].sort_by("sim_time")
    at = np.array(table["sim_time"].cast(pa.int64()).to_pylist()).reshape(-1, 3)
    height = np.array(table["Scalars:scalars"].to_pylist()).reshape(-1, 3)
    assert np.array_equal(at[:, 1], np.round(np.array([event.time_s for event in blows]) * 1e9))
    assert np.array_equal(at - at[:, 1:2], [[-1, 0, 1]] * len(blows))
    assert np.array_equal(height, [[0.0, event.impulse_ns, 0.0] for event in blows])


def test_nothing_of_the_wall_clock_enters_the_file(kept):
    assert not any(name.startswith("log_") for table in kept[0].values() for name in table.column_names)


def test_metrics_are_a_table_with_units(kept):
    text = kept[0]["/metrics"]["TextDocument:text"].to_pylist()[0][0]
    assert "| blow energy | 18.8 | J |" in text


def test_a_machine_without_body_gets_no_body_panels(tmp_path):
    path = tmp_path / "run.rrd"
    with RerunScene("four_bar", rrd_path=path) as scene:
        shown(scene, 200, with_body=False)
    moving, _ = rrd_tables(path)
    assert not any(entity.startswith(("/body/", "/phase_portrait")) for entity in moving)
    names = panel_names(SceneContents({"motor/torque": ("rotor",), "body_moment": ("moment on the body",)}, (), None))
    assert not any(word in names for word in ("Phase portrait", "Pressing force", "Body", "Moment on the body"))


def panel_names(contents):
    def names(part):
        found = [str(part.name)] if getattr(part, "name", None) else []
        return found + [name for inner in getattr(part, "contents", None) or () for name in names_of(inner)]

    def names_of(part):
        return names(part) if not isinstance(part, str) else []

    return " | ".join(names(blueprint(contents, 1.0).root_container))


def test_the_layout_has_a_panel_for_everything_there_is():
    curves = {"motor/torque": ("rotor",), "pins/magnitude": ("A",), "body/pressing_force": ("pressing force",)}
    names = panel_names(SceneContents(curves, ("body",), Bounds(0.0, 1.0, 0.0, 1.0)))
    for expected in ("Mechanism", "Torque, N m", "Pin reactions, N", "Pressing force, N", "Phase portrait: body"):
        assert expected in names
    for expected in ("Events", "Impacts", "Metrics"):
        assert expected in names


@pytest.mark.parametrize("names", [(), ("tool",), ("crank_bearing", "tool"), ("step begin moment",), ("x" * 60,)])
def test_the_room_beside_the_curves_is_as_wide_as_the_longest_name(names):
    share = legend_share(names)
    of_plot = share / (1.0 + share)
    assert of_plot == pytest.approx(min(0.09 + 0.0135 * max(map(len, names), default=0), 0.42))
    axis = plot("Torque, N m", ["motor/torque"], 2.0, names).properties["TimeAxis"]
    shown = axis.as_component_batches()[0].as_arrow_array().to_pylist()[0]
    assert shown["start"] == -2_000_000_000
    assert shown["end"] == pytest.approx(2e9 * share)


def test_the_axes_of_a_phase_portrait_have_units():
    logged, none = {}, Named((), ())

    class Stream:
        def log(self, path, what):
            logged[path] = what

    portrait = PhasePortrait("phase_portrait/body", "body", 0, 1.0)
    for time_s, angle, rate in ((0.0, 0.0, 0.0), (0.1, 0.004, -0.9)):
        portrait.add(BodySample(1, time_s, ("body",), (angle,), (rate,), (0.0,), 0, 0.0, none, none))
    portrait.log(Stream())
    labels = logged["phase_portrait/body/labels"].labels.as_arrow_array().to_pylist()
    assert labels == ["body 0.005 rad", "rate 1 rad/s", "-0.005 rad", "-1 rad/s"]


def test_scale_bars_stand_at_the_edges_of_what_the_page_shows(tmp_path):
    def draw(scene, step, x_m):
        line = Shape("link", "line", ((0.0, 0.0), (x_m, 0.1)), (0, 0, 0), 0.01)
        scene.drawing(Drawing(step, float(step), (line,)))

    with RerunScene("four_bar", rrd_path=tmp_path / "run.rrd") as scene:
        shown(scene, 100)
        draw(scene, 1000, 1.0)
        scene._lay_out()
        page = scene.visible_bounds()
        draw(scene, 1001, 1.0 + 0.01 * (page.right_m - page.left_m))
        assert scene.visible_bounds() == page, "a motion within the margin moves nothing"
        assert scene._mechanism.bounds() != page
        draw(scene, 1002, page.right_m + 1.0)
        assert scene.visible_bounds().right_m > page.right_m + 1.0


def test_an_empty_run_has_a_layout_too():
    assert "Mechanism" in panel_names(SceneContents({}, (), None))


def test_the_file_holds_its_layout(tmp_path):
    path = tmp_path / "run.rrd"
    with RerunScene("four_bar", rrd_path=path) as scene:
        shown(scene, 100)
    assert len(RrdReader(str(path)).blueprints()) >= 1


def test_samples_may_come_one_role_at_a_time(tmp_path):
    path = tmp_path / "run.rrd"
    with RerunScene("four_bar", rrd_path=path) as scene:
        for step in range(101):
            scene.frame(StepSamples(step, linkage=frame(step).linkage))
        for step in range(101):
            scene.frame(StepSamples(step, body=frame(step).body))
    moving, _ = rrd_tables(path)
    assert max(moving["/linkage/speed"]["step"].to_pylist()) == 100
    assert max(moving["/body/pressing_force"]["step"].to_pylist()) == 100


def test_of_the_shortest_steps_no_sample_is_left_out(tmp_path):
    path, count = tmp_path / "run.rrd", 2 * KEPT_SAMPLES + 1
    with RerunScene("four_bar", rrd_path=path) as scene:
        for step in range(count):
            motor = frame(0).motor._replace(step=step, time_s=1e-6 * step, effort=(float(-step),))
            scene.frame(StepSamples(step, motor=motor))
    rows = dict(zip(*sorted_rows(rrd_tables(path)[0]["/motor/torque"], "Scalars:scalars"), strict=True))
    assert rows[0] == 0.0
    assert rows[count - 1] == 1.0 - count


def test_names_that_change_start_curves_of_their_own(tmp_path):
    path = tmp_path / "run.rrd"
    with RerunScene("four_bar", rrd_path=path) as scene:
        for step in range(40):
            scene.frame(StepSamples(step, motor=frame(step).motor))
        for step in range(40, 81):
            sample = frame(step).motor
            motor = sample._replace(joints=("a", "b"), position=(0, 0), velocity=(1, 2), effort=(3.0, step * 1.0))
            scene.frame(StepSamples(step, motor=motor))
    moving, _ = rrd_tables(path)
    widths = {len(row) for row in moving["/motor/torque"]["Scalars:scalars"].to_pylist()}
    assert widths == {1, 2}


def test_what_is_no_longer_drawn_disappears(tmp_path):
    path = tmp_path / "run.rrd"
    arrow = Shape("load", "arrow", ((0.0, 0.0), (0.1, 0.0)), (0, 0, 0), 0.01)
    with RerunScene("four_bar", rrd_path=path) as scene:
        scene.drawing(Drawing(0, 0.0, (arrow,)))
        scene.drawing(Drawing(34, 0.034, ()))
    moving, _ = rrd_tables(path)
    counts = [len(row or ()) for row in moving["/mechanism/figure"]["Arrows2D:vectors"].to_pylist()]
    assert counts == [1, 0]


def test_an_unknown_shape_is_refused_by_name(tmp_path):
    with (
        RerunScene("four_bar", rrd_path=tmp_path / "run.rrd") as scene,
        pytest.raises(ValueError, match="lump: expected"),
    ):
        scene.drawing(Drawing(0, 0.0, (Shape("lump", "blob", (), (0, 0, 0), 0.01),)))


def test_a_file_that_cannot_be_written_is_refused_in_one_line(tmp_path):
    with pytest.raises(RerunSceneError, match=r"no_room.*cannot be written") as refusal:
        RerunScene("four_bar", rrd_path=tmp_path / "no_room" / "run.rrd")
    assert "\n" not in str(refusal.value)


def test_a_body_that_rests_is_drawn_without_fault(tmp_path):
    still = BodySample(0, 0.0, ("body",), (0.0,), (0.0,), (0.0,), 0, 0.0, Named(), Named())
    with RerunScene("four_bar", rrd_path=tmp_path / "run.rrd") as scene:
        for step in range(101):
            scene.frame(StepSamples(step, body=still._replace(step=step, time_s=step * 0.001)))


@pytest.mark.parametrize(("value", "scale"), [(0.0, 1.0), (0.0054, 0.01), (0.24, 0.5), (1.0, 1.0), (7.3, 10.0)])
def test_axes_end_at_a_round_number(value, scale):
    assert round_above(value) == pytest.approx(scale)


def test_an_event_is_told_in_words():
    told = event_line(Event(1.25, "blow", "tool", 1.58, -0.55, 20.9, 12))
    assert told == "1.250000 s  blow (tool)  +1.58 -> -0.55 m/s  20.9 N s  cycle 12"
    assert event_line(Event(1.0, "reset", "linkage")) == "1.000000 s  reset (linkage)  cycle 0"


def test_the_banner_of_a_file_has_the_headline_numbers_of_the_bench(tmp_path):
    """The file's banner heard nothing of the body: pressing force and contact share were on the bench alone."""
    machine, path, banner = built_machine("mb10_breaker"), tmp_path / "run.rrd", Banner(None)
    with RerunScene("mb10_breaker", rrd_path=path) as scene:
        for shows in (scene, banner):
            shows.watch(machine)
            shows.know(machine.mechanism, machine.blow_energy)
        for now in frames(machine, 0.3):
            scene.frame(now)
            banner.add(now)
            for event in frame_events(now):
                scene.event(event)
                banner.strike(event)
    assert rrd_tables(path)[0]["/banner"]["TextDocument:text"].to_pylist()[-1] == [banner.text()]
    assert re.search(r"pressing force \d+ N  ·  contact share \d+ %", banner.text())
