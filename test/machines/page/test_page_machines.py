# SPDX-License-Identifier: Apache-2.0
"""Shipped pages against the machines written by hand, and against what is known of the mechanism."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker.dynamics import striker
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parameters.load import machine
from mech_twin.roles import CrankState

PAGES = Path(__file__).resolve().parents[3] / "config" / "pages"
RUN_S = 10.0


def told(name, duration_s=RUN_S, **overrides):
    """Return the frames of a run."""
    return list(frames(machine(name, None, {k.replace("__", "."): v for k, v in overrides.items()}), duration_s))


def page(name):
    """Return the path of a shipped page."""
    return str(PAGES / f"{name}.yaml")


def wrench(frame, pin):
    """Return the force of a pin (N)."""
    found = frame.forces.wrenches[frame.forces.pins.index(pin)]
    return np.array(found[:2])


@cache
def linkage_of(name):
    """Return the linkage of a machine as installed."""
    return machine(name).linkage


def at_angle_of(name, frame, angle):
    """Return a machine's linkage at the step of a frame and a crank angle: its own is a sum of rounded steps."""
    speed = frame.linkage.joint("crank_bearing").velocity
    return linkage_of(name).guided(frame.linkage.step, frame.linkage.time_s, CrankState(angle, speed, 0.0))


@pytest.mark.slow
def test_the_impact_mass_strikes_as_the_machine_does():
    ours, theirs = told(page("impact_mass")), told("impact_mass")
    found = [e for f in ours for e in f.linkage.events if e.kind == "impact" and e.pre_velocity_m_per_s > 1e-3]
    expected = [e for f in theirs for e in f.linkage.events if e.kind == "impact" and e.pre_velocity_m_per_s > 1e-3]
    assert len(found) == len(expected) > 400
    for a, b in zip(found, expected, strict=True):
        assert a.time_s == pytest.approx(b.time_s, abs=1e-9)
        assert a.pre_velocity_m_per_s == pytest.approx(b.pre_velocity_m_per_s, abs=1e-8)
    for a, b in zip(ours, theirs, strict=True):
        assert a.linkage.position[0] == pytest.approx(b.linkage.position[0], abs=1e-10)


@pytest.mark.slow
def test_the_vibration_crank_has_the_machine_s_motion_torque_and_pins():
    ours, theirs = told(page("vibration_crank")), told("vibration_crank")
    peak = max(np.abs(wrench(f, "crank_pin")).max() for f in theirs)
    torque = max(abs(f.linkage.effort[0]) for f in theirs)
    for a, b in zip(ours[1:], theirs[1:], strict=True):
        exact = 5.0 * math.pi * a.linkage.time_s
        assert a.linkage.joint("crank_bearing").position == pytest.approx(exact, abs=1e-12)
        there = at_angle_of("vibration_crank", a, exact)
        assert a.linkage.joint("guide").position == pytest.approx(there.joint("slider").position, abs=1e-12)
        assert a.linkage.joint("guide").velocity == pytest.approx(b.linkage.joint("slider").velocity, abs=1e-10)
        assert a.linkage.effort[0] == pytest.approx(b.linkage.effort[0], abs=1e-8 * torque)
        assert wrench(a, "follower_pin") == pytest.approx(-wrench(b, "follower_pin"), abs=1e-8 * peak) or (
            wrench(a, "follower_pin") == pytest.approx(wrench(b, "follower_pin"), abs=1e-8 * peak)
        )


@pytest.mark.slow
def test_the_press_has_the_machine_s_motion_and_torque():
    ours, theirs = told(page("press")), told("compaction_press", working_force__peak_n=0.0)
    torque = max(abs(f.linkage.effort[0]) for f in theirs)
    start, speed = theirs[0].linkage.joint("crank").position, theirs[0].linkage.joint("crank").velocity
    for a, b in zip(ours[1:], theirs[1:], strict=True):
        turned = a.linkage.joint("crank_bearing").position
        exact = start + speed * a.linkage.time_s
        assert 0.06 * (turned - exact) == pytest.approx(0.0, abs=1e-12)
        there = at_angle_of("compaction_press", a, exact)
        plate, pendulum = (there.joint(name).position for name in ("plate", "pendulum"))
        ours_plate = turned + a.linkage.joint("crank_pin").position
        assert 0.5 * math.remainder(ours_plate - plate, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)
        swung = a.linkage.joint("pendulum_bearing").position
        assert 0.3 * math.remainder(swung - pendulum, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)
        assert a.linkage.effort[0] == pytest.approx(b.linkage.effort[0], abs=1e-8 * torque)


TILT_RAD = math.asin(0.25)  # of the breaker's ground link in the body's frame of its page


def blows(run, kind, contact):
    """Return instant (s), speed (m/s) and impulse (N s) of each blow of striker and tool."""
    events = [e for f in run for e in f.linkage.events if (e.kind, e.contact) == (kind, contact)]
    return np.array([(e.time_s, e.pre_velocity_m_per_s, e.impulse_ns) for e in events if e.pre_velocity_m_per_s > 1e-3])


@cache
def coasting(step_s):
    """Return the breaker without supply from a sample on, its body and tool at rest, and its page from there."""
    keys, off = {"coupling.step_s": step_s}, round(1.5 / step_s)
    run = list(frames(machine("mb10_breaker", None, keys | {"supply.rate_per_s": 1e6}), 2.4, lambda n: float(n < off)))
    rests = (
        k
        for k, f in enumerate(run)
        if k > off + 5
        and 3.0 < f.linkage.joint("crank").position < 4.5
        and f.linkage.joint("body").velocity == f.linkage.joint("body").position == 0.0
        and f.linkage.memory["tool_travel_m"] == f.linkage.memory["tool_speed_m_per_s"] == 0.0
    )
    run = run[next(rests) :]
    crank, coupler, rocker, _ = run[0].linkage.position
    own = breaker(machine("mb10_breaker").parameters)
    start = {
        "crank_bearing.start_deg": math.degrees(crank + TILT_RAD),
        "crank_bearing.start_rad_per_s": run[0].linkage.velocity[0],
        "crank_pin.start_deg": math.degrees(coupler - crank),
        "rocker_bearing.start_deg": math.degrees(rocker + TILT_RAD),
        "striker_guide.start_m": striker(own, crank)[0],
    }
    begun = keys | {"supply.initial_fraction": 0.0} | {f"joints.{key}": value for key, value in start.items()}
    steps = len(run) - 0.5
    return run, list(frames(machine(page("breaker"), None, begun), steps * step_s, lambda n: 0.0))


def test_the_breaker_has_the_machine_s_motion_pins_and_blow_while_its_body_rests():
    theirs, ours = coasting(5e-4)
    begin_s, first, there = theirs[0].linkage.time_s, blows(ours, "impact", "blow")[0], blows(theirs, "blow", "tool")[0]
    assert begin_s + first[0] == pytest.approx(there[0], abs=1e-12)
    assert first[1:] == pytest.approx(there[1:], rel=1e-11)
    together = [(a, b) for a, b in zip(ours, theirs, strict=False) if a.linkage.time_s < first[0]]
    assert len(together) > 20
    for pin in ("crank_pin", "rocker_bearing"):
        peak = max(math.hypot(*wrench(b, pin)) for _, b in together)
        for a, b in together:
            assert math.hypot(*wrench(a, pin)) == pytest.approx(math.hypot(*wrench(b, pin)), abs=1e-8 * peak)
    for a, b in together:
        turned = a.linkage.joint("crank_bearing").position - TILT_RAD - b.linkage.joint("crank").position
        assert 0.03 * math.remainder(turned, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-12)


def test_the_breaker_coasts_as_the_machine_does():
    theirs, ours = coasting(1e-3)
    there, here = blows(theirs, "blow", "tool"), blows(ours, "impact", "blow")
    assert len(here) == len(there) >= 8
    assert theirs[0].linkage.time_s + here[:, 0] == pytest.approx(there[:, 0], abs=1e-9)


@pytest.mark.slow
def test_the_breaker_runs_up_as_the_machine_does():
    """Page and machine hold the motor's torque differently within a step of 1 ms."""
    theirs, ours = told("mb10_breaker"), told(page("breaker"))
    there, here = blows(theirs, "blow", "tool"), blows(ours, "impact", "blow")
    assert len(here) == len(there) >= 95
    assert here[:, 0] == pytest.approx(there[:, 0], abs=2e-5)
    assert here[:, 1:] == pytest.approx(there[:, 1:], rel=1e-5)
    feeds = [max(f.linkage.memory["feed_per_blow_m"] for f in theirs), max(f.linkage.position[2] for f in ours)]
    assert feeds[1] == pytest.approx(feeds[0], rel=1e-5)


def test_chebyshev_s_tracer_runs_nearly_straight():
    """Links 2 : 5 : 5 on 4: the tracer is at height 4 where the coupler is level or upright, and nearly so between."""
    numbers = [f.forces.quantities for f in told(page("chebyshev"), 1.0)]
    path = np.array([(q["tracer_x_m"], q["tracer_y_m"]) for q in numbers])
    straight = path[(np.abs(path[:, 0]) <= 0.2) & (path[:, 1] < 0.43)]
    assert np.ptp(straight[:, 0]) > 0.395
    assert np.abs(straight[:, 1] - 0.4).max() < 0.01 * np.ptp(straight[:, 0])
    assert path[:, 1].max() > 0.48  # the way back is a bow


def test_the_quick_return_has_the_ratio_of_its_angles():
    """Crank 0.15 m, pivot 0.3 m below: the lever turns round at cos(a) = 0.5, so the ratio is 240 : 120 degrees."""
    run = told(page("quick_return"), 1.0)
    angles = np.array([f.linkage.joint("lever_pivot").velocity for f in run[:-1]])
    slow = float(np.mean(angles > 0.0)) if np.mean(angles > 0.0) > 0.5 else float(np.mean(angles < 0.0))
    assert slow == pytest.approx(240.0 / 360.0, abs=2e-3)


def test_the_rammer_jumps_and_its_books_balance():
    built = machine(page("rammer"))
    run = list(frames(built, 4.0))
    blows = [e for f in run for e in f.linkage.events if e.kind == "impact" and e.pre_velocity_m_per_s > 0.1]
    assert len(blows) > 5
    assert max(f.linkage.joint("mast").position - f.linkage.joint("leg").position for f in run) > 0.005
    for f in run:
        for name, value in f.linkage.residuals.as_dict().items():
            assert abs(value) <= built.linkage.residual_limits[name], (name, f.linkage.time_s)
