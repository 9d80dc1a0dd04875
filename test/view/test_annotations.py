# SPDX-License-Identifier: Apache-2.0
"""What is written over a drawing: forces to scale at their pins, blows with their energy, the line above."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from catalogue import NAMES, built

from mech_twin.capabilities.mechanism import poses
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import StepSamples, frame_events
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.measurements.units import leading_in
from mech_twin.parameters.load import machine
from mech_twin.samples import Event
from mech_twin.view.annotations import FLASH_S, Annotations, Banner, lost_energy
from mech_twin.view.extent import Bounds, is_logged, with_prefix, written_beside

BOUNDS = Bounds(-1.0, 1.0, -0.8, 0.8)


def run_of(name, seconds):
    machine = built(name)
    notes = Annotations(machine.mechanism, machine.blow_energy or lost_energy)
    banner = Banner(machine.mechanism, machine.blow_energy or lost_energy)
    for frame in frames(machine, seconds):
        notes.add(frame.linkage, frame.forces)
        banner.add(frame)
        for event in frame_events(frame):
            notes.strike(event)
            banner.strike(event)
    return machine, frame, notes, banner


@pytest.mark.parametrize("name", NAMES)
def test_arrows_of_the_pin_reactions_stand_at_their_pins_in_one_scale(name):
    _, frame, notes, _ = run_of(name, 0.3)
    machine = built(name)
    at = poses(machine.mechanism, dict(zip(frame.linkage.joints, frame.linkage.position, strict=True)))
    shapes = {shape.name: shape for shape in notes.shapes(frame.linkage.time_s, BOUNDS)}
    bar = shapes["force_scale"]
    value, unit = bar.text.split()
    newtons_per_m = float(value) * {"N": 1.0, "kN": 1e3}[unit] / math.dist(*bar.points_m)
    drawn = 0
    for pin, wrench in zip(frame.forces.pins, frame.forces.wrenches, strict=True):
        if f"force_{pin}" not in shapes:
            continue
        (x, y), (head_x, head_y) = shapes[f"force_{pin}"].points_m
        assert (x, y) == pytest.approx((at[pin].x_m, at[pin].y_m), abs=1e-12)
        assert newtons_per_m * (head_x - x) == pytest.approx(wrench.force_x_n, rel=1e-9, abs=1e-9)
        assert newtons_per_m * (head_y - y) == pytest.approx(wrench.force_y_n, rel=1e-9, abs=1e-9)
        assert pin.replace("_", " ") in shapes["pin_forces"].text
        drawn += 1
    assert drawn > 0 or name == "impact_mass"


def test_the_length_scale_is_as_long_as_it_says():
    _, frame, notes, _ = run_of("winding_drum", 0.05)
    bar = next(shape for shape in notes.shapes(frame.linkage.time_s, BOUNDS) if shape.name == "length_scale")
    begin, end = bar.points_m[2:4]
    assert bar.text == "200 mm"
    assert math.dist(begin, end) == pytest.approx(0.2)


def test_a_blow_is_shown_where_it_falls_with_the_energy_of_the_tool_after_it():
    machine, _, notes, banner = run_of("mb10_breaker", 1.4)
    blows = [event for frame in frames(machine, 1.4) for event in frame_events(frame) if event.contact == "tool"]
    last = blows[-1]
    mass_kg = breaker(machine.parameters).tool_mass_kg
    speed_m_per_s = last.impulse_ns / mass_kg
    shapes = {shape.name: shape for shape in notes.shapes(last.time_s + 0.5 * FLASH_S, BOUNDS)}
    assert shapes["blow_energy"].text == with_prefix(0.5 * mass_kg * speed_m_per_s**2, "J")
    assert "blow" not in {shape.name for shape in notes.shapes(last.time_s + 1.01 * FLASH_S, BOUNDS)}
    assert re.search(r"blow rate \d+\.\d/s  ·  last blow at \d+\.\d\d s \d+\.\d J", banner.text())
    assert "no alarm" in banner.text()


def test_the_energy_that_is_lost_is_that_of_the_mass_before_and_after():
    mass_kg, before, after = 10.0 / 3.0, 2.0, -1.0
    event = Event(0.0, "impact", "stop", before, after, mass_kg * (before - after))
    assert lost_energy(event) == pytest.approx(0.5 * mass_kg * (before**2 - after**2))


def test_the_line_above_says_state_and_speed_in_their_units():
    assert " rad/s" in run_of("compaction_press", 0.1)[3].text()
    assert "m/s" in run_of("impact_mass", 0.1)[3].text()
    _machine, frame, _, banner = run_of("compaction_press", 0.1)
    banner.add(StepSamples(0, motor=frame.motor._replace(command=0.0)))
    assert "running down" in banner.text()
    broken = frame.linkage._replace(position=(math.nan, *frame.linkage.position[1:]))
    banner.add(StepSamples(0, linkage=broken))
    assert "ALARM: crank is not finite" in banner.text()


def test_joints_that_slide_are_known_by_name():
    assert built("impact_mass").mechanism.sliding_joints >= {"mass", "generator"}
    assert built("winding_drum").mechanism.sliding_joints >= {"yarn", "package_radius"}
    assert not built("mb10_breaker").mechanism.sliding_joints


@pytest.mark.parametrize(
    ("event", "told"),
    [
        (Event(0.0, "touchdown", "collar", -2e-7, 1e-7, 4e-8), False),
        (Event(0.0, "touchdown", "collar", -0.1, 0.04, 1.0), True),
        (Event(0.0, "load_engaged", "crank"), True),
    ],
)
def test_changes_of_state_and_impacts_are_told_touches_are_not(event, told):
    assert is_logged(event) == told


@pytest.mark.parametrize("name", NAMES)
def test_what_is_written_beside_a_line_does_not_lie_on_it(name):
    machine = built(name)
    width = 2.0
    written = [
        shape for shape in machine.draw(machine.linkage.start(), None) if shape.text and len(shape.points_m) == 2
    ]
    assert written or name in ("impact_mass", "winding_drum")
    for shape in written:
        text = written_beside(shape, width)
        half = 0.5 * len(shape.text) * 6.6 * width / 700.0
        (x, top), height = text.points_m[0], 20.0 * width / 700.0
        (ax, ay), (bx, by) = shape.points_m
        for i in range(101):
            px, py = ax + (bx - ax) * i / 100.0, ay + (by - ay) * i / 100.0
            assert not (abs(px - x) < half and top - height < py < top), shape.name


GROUNDS = {"light": (255, 255, 255), "dark": (13, 16, 17)}  # of the viewer's themes


def luminance(colour):
    """Return the relative luminance of a colour (WCAG 2)."""
    linear = [c / 12.92 if c <= 0.03928 else ((c + 0.055) / 1.055) ** 2.4 for c in (part / 255.0 for part in colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("theme", GROUNDS)
@pytest.mark.parametrize("name", NAMES)
def test_every_colour_of_a_drawing_is_told_from_the_ground_of_either_theme(name, theme):
    machine, frame, notes, _ = run_of(name, 0.05)
    shapes = (*machine.draw(frame.linkage, frame.body), *notes.shapes(frame.linkage.time_s, BOUNDS))
    assert len(shapes) > 5
    for shape in shapes:
        low, high = sorted((luminance(shape.colour), luminance(GROUNDS[theme])))
        assert (high + 0.05) / (low + 0.05) > 2.5, shape.name


def test_the_headline_counts_a_series_of_bounces_as_one_blow():
    """The mass strikes its stop once a period of the force (0.05 s) and bounces there, ever weaker."""
    machine, *_, banner = run_of("impact_mass", 3.0)
    cards = {card.key: card for card in banner.cards()}
    assert cards["blow rate"].value == pytest.approx(1.0 / machine.parameters.period_s, rel=0.01)
    struck = [event for frame in frames(machine, 3.0) for event in frame_events(frame) if event.time_s > 2.9]
    assert cards["last blow"].value == max(map(lost_energy, struck))


def test_two_blows_close_together_are_no_rate_of_a_thousand_a_second():
    machine = built("impact_mass")
    banner = Banner(machine.mechanism, lambda event: event.impulse_ns)
    for frame in frames(machine, 2.5):
        banner.add(frame)
    for time_s in (1.999, 2.0):
        banner.strike(Event(time_s, "impact", "stop", 1.0, -0.5, 3.0, 0))
    rate = next(card for card in banner.cards() if card.key == "blow rate")
    assert rate.value == pytest.approx(1.0), "two in the last two seconds"


@pytest.mark.parametrize(
    ("value", "shown"),
    [(999.4, "999 N"), (999.6, "1 kN"), (999_960.0, "1 MN"), (2.5e9, "2.5 GN"), (9.996e-4, "1 mN"), (-999.6, "-1 kN")],
)
def test_a_number_rounded_up_to_a_thousand_gets_the_next_prefix(value, shown):
    assert with_prefix(value, "N") == shown


def test_the_speed_of_a_shaft_at_rest_is_shown_as_zero():
    machine = built("mb10_breaker")
    banner = Banner(machine.mechanism)
    frame = next(iter(frames(machine, 0.1)))
    banner.add(frame._replace(linkage=frame.linkage._replace(velocity=(2.8e-30,) * len(frame.linkage.joints))))
    assert banner.cards()[0].shown == "0 rad/s"


@pytest.mark.parametrize(("page", "drive", "joint"), [("rammer", "engine", "shaft"), ("sommerfeld", "motor", "shaft")])
def test_the_leading_joint_is_that_of_the_drive(page, drive, joint):
    built_page = machine(str(Path(__file__).parents[2] / "config" / "pages" / f"{page}.yaml"))
    assert leading_in(built_page) == joint == built_page.parameters.drives[drive].joint
    banner = Banner(built_page.mechanism)
    for frame in frames(built_page, 0.01):
        banner.add(frame)
    card = banner.cards()[0]
    assert (card.name, card.unit, card.value) == (joint, "rad/s", frame.linkage.joint(joint).velocity)
