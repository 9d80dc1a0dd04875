# SPDX-License-Identifier: Apache-2.0
"""Headline numbers carry their unit, and of a machine with a rated motor what that is rated for."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest
from catalogue import built
from crank_drives import PRESS_KLOSS

from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import StepSamples, frame_events
from mech_twin.parameters.load import machine as machine_of
from mech_twin.samples import Drawing, Event, Frame
from mech_twin.view.annotations import RECENT_S, Banner
from mech_twin.view.bench.link import encoded
from mech_twin.view.bench.scene import BenchScene
from mech_twin.view.sending import RECORDED


def test_without_samples_of_the_motor_its_power_is_that_of_the_drive_beside_no_rating():
    machine = built("roller_former")
    banner = Banner(machine.mechanism)
    banner.watch(machine)
    for frame in frames(machine, 0.1):
        banner.add(StepSamples(0, frame.linkage, forces=frame.forces))
    card = next(card for card in banner.cards() if card.unit == "W")
    assert (card.key, card.most) == ("mean drive power", None)
    assert card.value != 0.0


@pytest.mark.parametrize(
    ("name", "overrides", "ratio", "rated_w"),
    [("roller_former", {}, 9.8, 11000.0), ("compaction_press", PRESS_KLOSS, 4.8, 2200.0)],
)
def test_beside_the_rated_power_of_a_motor_stands_its_mean_power_at_the_shaft(name, overrides, ratio, rated_w):
    """What a gear loses is power of the motor: 10.7 kW stood there as 9.6 kW."""
    machine = machine_of(name, None, overrides)
    banner, run = Banner(machine.mechanism), list(frames(machine, 5.0))
    banner.watch(machine)
    for frame in run:
        banner.add(frame)
    cards = {card.key: card for card in banner.cards()}
    power = cards["mean motor power"]
    turned = np.array([frame.motor.position[0] for frame in run])
    last = np.flatnonzero(turned >= turned[-1] - 2.0 * np.pi * ratio)
    torque = np.array([frame.motor.effort[0] for frame in run])[last]
    mean_w = np.trapezoid(torque, turned[last]) / (run[-1].motor.time_s - run[last[0]].motor.time_s)
    assert (power.unit, power.most) == ("W", rated_w)
    assert power.value == pytest.approx(mean_w, rel=0.01)
    assert all(card.most is None for key, card in cards.items() if key != "mean motor power")


@pytest.mark.parametrize(
    ("name", "rpm"), [("compaction_press", 40.0), ("compaction_press", 77.0), ("vibration_crank", 40.0)]
)
def test_the_mean_drive_power_is_that_of_whole_turns(name, rpm):
    machine = machine_of(name, None, {"drive.speed_rpm": rpm})
    banner, shown = Banner(machine.mechanism), []
    for frame in frames(machine, 4.0):
        banner.add(frame)
        if frame.linkage.time_s > 3.0:
            shown.append({card.key: card for card in banner.cards()}["mean drive power"].value)
    expected = machine.report()["power_mean_w"] if name == "compaction_press" else 0.0
    peak = max(abs(_power(frame)) for frame in frames(machine, 2.0))
    assert np.abs(np.array(shown) - expected).max() < 1e-3 * peak


def _power(frame):
    return frame.forces.quantities.values[frame.forces.quantities.names.index("drive_power_w")]


@pytest.mark.slow
def test_headline_numbers_of_a_run_that_begins_anew_know_nothing_of_the_one_before():
    machine = built("mb10_breaker")
    first, again = Banner(machine.mechanism, machine.blow_energy), Banner(machine.mechanism, machine.blow_energy)
    first.watch(machine)
    again.watch(machine)
    run = list(frames(machine, 3.0))
    for banner, begin in ((first, run), (again, [])):
        for frame in [*begin, *run[:700]]:
            banner.add(frame)
            for event in frame_events(frame):
                banner.strike(event)
    assert first.cards() == again.cards()


def test_one_blow_far_harder_than_the_others_does_not_make_bounces_of_them():
    """The mass first strikes with six times the energy it then has: for two seconds its blow rate was an eighth."""
    machine = built("impact_mass")
    banner = Banner(machine.mechanism)
    for frame in frames(machine, 1.9):
        banner.add(frame)
        for event in frame_events(frame):
            banner.strike(event)
    cards = {card.key: card for card in banner.cards()}
    period_s = machine.parameters.period_s
    assert cards["blow rate"].value == pytest.approx(1.0 / period_s, rel=0.02)
    assert float(cards["last blow"].name.split()[3]) > 1.9 - period_s


def later(frame, by_s):
    """Return a frame as it is at a later time."""
    moved = Frame(*(None if each is None else each._replace(time_s=each.time_s + by_s) for each in frame))
    events = tuple(event._replace(time_s=event.time_s + by_s) for event in frame.linkage.events)
    return moved._replace(linkage=moved.linkage._replace(events=events))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mb10_breaker", "roller_former"])
def test_headline_numbers_after_a_reset_know_nothing_of_the_time_before_it(name):
    """A reset returns to the initial state, and time goes on."""
    machine = built(name)
    shown = []
    for reset_s in (0.0, 2.0):
        banner = Banner(machine.mechanism, *filter(None, [machine.blow_energy]))
        banner.watch(machine)
        again = [later(frame, reset_s) for frame in frames(machine, 1.0)]
        reset = again[0].linkage._replace(events=(Event(reset_s, "reset", "linkage"),))
        run = [*frames(machine, reset_s - machine.coupling_step_s), again[0]._replace(linkage=reset), *again[1:]]
        for frame in run if reset_s else again:
            banner.add(frame)
            for event in frame_events(frame):
                banner.strike(event)
        shown.append({card.key: card.value for card in banner.cards()})
    assert len(shown[0]) > 1
    assert shown[1] == pytest.approx(shown[0], rel=1e-9)


def test_the_mean_drive_power_after_a_gap_is_that_of_the_turns_after_it():
    """A recording of the seconds before each trigger has gaps: 753 W were shown as 280 W, as of turns in the gap."""
    machine = built("compaction_press")
    banner, shown = Banner(machine.mechanism), []
    for frame in frames(machine, 7.0):
        if not 1.0 < frame.linkage.time_s < 4.9:
            banner.add(frame)
        if frame.linkage.time_s > 5.2:
            shown.append({card.key: card for card in banner.cards()}["mean drive power"].value)
    assert np.array(shown) == pytest.approx(machine.report()["power_mean_w"], rel=1e-3)


def test_an_alarm_and_the_last_blow_outlast_a_gap_of_a_recording():
    machine = built("mb10_breaker")
    banner, run = Banner(machine.mechanism, machine.blow_energy), list(frames(machine, 0.5))
    last = run[-1].linkage
    banner.add(StepSamples(0, last._replace(position=(np.nan, *last.position[1:]))))
    banner.strike(next(event for frame in run for event in frame.linkage.events if event.kind == "blow"))
    told = banner.alarm()
    banner.add(StepSamples(1, last._replace(time_s=last.time_s + 5.0)))
    assert told
    assert banner.alarm() == told
    assert "last blow" in {card.key for card in banner.cards()}


def test_a_value_that_is_not_finite_is_no_alarm_after_a_reset():
    machine, banner = built("vibration_crank"), Banner(None)
    begin = next(frames(machine, 0.1)).linkage
    for linkage in (begin, begin._replace(position=(np.nan,) * len(begin.joints)), begin):
        banner.add(StepSamples(0, linkage=linkage))
    assert banner.alarm()
    banner.add(StepSamples(0, linkage=begin._replace(events=(Event(0.0, "reset", "linkage"),))))
    assert banner.alarm() == ""


def test_a_machine_whose_configuration_tells_no_rated_power_has_no_limit():
    machine = built("vibration_crank")
    banner = Banner(machine.mechanism)
    banner.watch(machine)
    for frame in frames(machine, 0.1):
        banner.add(frame)
    (power,) = [card for card in banner.cards() if card.key == "mean drive power"]
    assert power.most is None


@pytest.mark.slow
def test_pressing_force_and_contact_share_are_those_of_the_last_two_seconds():
    machine = built("mb10_breaker")
    banner = Banner(machine.mechanism, machine.blow_energy)
    banner.watch(machine)
    run = list(frames(machine, 3.0))
    for frame in run:
        banner.add(frame)
    recent = [frame.body for frame in run if frame.body.time_s >= run[-1].body.time_s - RECENT_S]
    cards = {card.key: card for card in banner.cards()}
    mean_n = sum(body.pressing_force_n for body in recent) / len(recent)
    assert cards["mean pressing force"].value == pytest.approx(mean_n, rel=1e-12)
    assert min(body.pressing_force_n for body in recent) < mean_n < max(body.pressing_force_n for body in recent)
    resting = [body for body in recent if machine.body.regimes[body.regime] == "rest"]
    assert 0 < len(resting) < len(recent)
    assert cards["contact share"].value == pytest.approx(100.0 * len(resting) / len(recent), rel=1e-12)
    assert cards["mean pressing force"].shown.endswith(" N")


class NotedLink:
    """A link that keeps the pictures."""

    def __init__(self):
        self.pictures = []

    def tell(self, kind, content):
        return True

    def show(self, picture):
        self.pictures.append(picture)
        return True

    def close(self):
        self.pictures = tuple(self.pictures)


def test_what_came_after_the_last_drawing_is_shown_before_the_scene_closes():
    """A recording holds a drawing every 20 or 30 ms: the steps and events after the last one are of the run too."""
    machine, link = built("impact_mass"), NotedLink()
    run = [frame for frame in frames(machine, 0.5) if frame.linkage.time_s > 0.3]
    with BenchScene(link, RECORDED) as scene:
        scene.know(machine.mechanism)
        for place, frame in enumerate(run):
            scene.frame(frame)
            for event in frame_events(frame):
                scene.event(event)
            if place == 0:
                scene.drawing(Drawing(0, frame.linkage.time_s, machine.draw(frame.linkage, None)))
    first, last = link.pictures
    assert last["time_s"] == pytest.approx(run[-1].linkage.time_s, abs=1e-9)
    assert (first["shapes"] is None, last["shapes"] is None) == (False, True)
    curve_s = np.frombuffer(base64.b64decode(last["curves"]["pins/magnitude"][0]))
    assert curve_s[-1] > run[-1].linkage.time_s - RECORDED.window * machine.coupling_step_s
    happened = [event.time_s for frame in run for event in frame_events(frame)]
    assert last["events"][-1][0] == happened[-1]


@pytest.mark.slow
def test_after_a_reset_the_drawing_is_to_the_scale_of_the_new_run():
    """Where a bad value once threw the mass far away, the machine would stay a point."""
    installed, thrown = built("impact_mass"), machine_of("impact_mass", overrides={"phase1_force_n": -1e6})
    drawn = {}
    for name, before in (("alone", ()), ("after", (*frames(thrown, 0.2),))):
        link = NotedLink()
        with BenchScene(link, RECORDED) as scene:
            scene.know(installed.mechanism)
            for frame in (*before, *frames(installed, 0.2)):
                if before and frame.linkage.step == 0 and frame is not before[0]:
                    scene.event(Event(frame.linkage.time_s, "reset", "mass", 0, 0.0, 0.0, 0.0))
                scene.frame(frame)
                scene.drawing(Drawing(0, frame.linkage.time_s, installed.draw(frame.linkage, None)))
        drawn[name] = link.pictures[-1]
    assert drawn["after"]["bounds"] == drawn["alone"]["bounds"]
    assert drawn["after"]["shapes"] == drawn["alone"]["shapes"]


def test_a_value_that_is_not_finite_reaches_the_page_as_an_alarm_with_its_first_time():
    """A page refuses a picture with NaN as JSON, and would stand still without a word."""
    machine, link = built("vibration_crank"), NotedLink()
    with BenchScene(link, RECORDED) as scene:
        scene.know(machine.mechanism)
        for frame in frames(machine, 0.1):
            linkage, nothing = frame.linkage, (np.nan,) * len(frame.linkage.joints)
            if linkage.time_s > 0.05:
                linkage = linkage._replace(velocity=nothing, position=nothing)
            scene.frame(frame._replace(linkage=linkage))
            scene.drawing(Drawing(linkage.step, linkage.time_s, machine.draw(linkage, None)))
    told = json.loads(encoded(link.pictures[-1], finite=True), parse_constant=pytest.fail)
    first_s = next(frame.linkage.time_s for frame in frames(machine, 0.1) if frame.linkage.time_s > 0.05)
    assert told["alarm"] == f"crank is not finite at {first_s:.3f} s"
    assert told["cards"][0][1:4] == ["nan rad/s", "crank", None]
    assert None not in told["bounds"]
