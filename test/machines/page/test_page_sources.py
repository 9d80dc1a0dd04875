# SPDX-License-Identifier: Apache-2.0
"""Shipped pages against the roller former, an integration of their own, and the averaged motion of the literature."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from machines.page.test_page_machines import page, told, wrench
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine


@pytest.mark.slow
@pytest.mark.parametrize("carts", [2, 4])
def test_the_roller_former_swings_as_the_machine_does(carts):
    """Without supply, from full speed: the carts swing against the elastic drive."""
    off = {"supply.initial_fraction": 0.0}
    own = {"load": "none", "carts.count": carts, "integrator.tolerance": 1e-13, "start.speed_fraction": 1.0}
    theirs = list(frames(machine("roller_former", None, off | own), 10.0, lambda step: 0.0))
    speed = theirs[0].linkage.joint("crank").velocity
    begun = {f"joints.{shaft}.start_rad_per_s": speed for shaft in ("crank_shaft", "drive_shaft")}
    ours = list(frames(machine(page(f"roller_former_{carts}"), None, off | begun), 10.0, lambda step: 0.0))
    peak = max(np.abs(wrench(f, "cart_pin_1")).max() for f in theirs)
    for a, b in zip(ours, theirs, strict=True):
        turned = a.linkage.joint("crank_shaft").position - b.linkage.joint("crank").position
        assert 0.2 * turned == pytest.approx(0.0, abs=1e-12)
        for k in range(1, carts + 1):
            cart = b.linkage.joint(f"cart_{k}").position
            assert a.linkage.joint(f"rail_{k}").position == pytest.approx(cart, abs=1e-12)
            force, expected = wrench(a, f"wrist_{k}"), wrench(b, f"cart_pin_{k}")
            assert min(np.abs(force - expected).max(), np.abs(force + expected).max()) <= 1e-8 * peak


@pytest.mark.slow
def test_the_roller_former_starts_as_the_machine_does_when_the_step_is_short():
    """Page and machine hold the motor's torque differently within a step: what parts them goes with its square."""
    parted = []
    for step_s in (1e-3, 5e-4):
        keys = {"coupling__step_s": step_s}
        theirs = told("roller_former", 0.8, load="none", integrator__tolerance=1e-12, **keys)[-1]
        ours = told(page("roller_former_2"), 0.8, **keys)[-1]
        parted.append(ours.linkage.joint("crank_shaft").position - theirs.linkage.joint("crank").position)
    assert parted[0] / parted[1] == pytest.approx(4.0, rel=5e-3)
    assert (4.0 * parted[1] - parted[0]) / 3.0 == pytest.approx(0.0, abs=1e-8)


@pytest.mark.slow
def test_a_weak_motor_hangs_at_the_speed_of_the_averaged_motion():
    """KononenkoSupply1969: the motor's torque is what the vibration takes at its speed, c w X(w)^2 / 2."""
    mass, rate, damping, unbalance, no_load = 100.0, 1e6, 400.0, 0.05, 50.0 * math.pi

    def taken(w):
        return 0.5 * damping * w * (unbalance * w * w) ** 2 / ((rate - mass * w * w) ** 2 + (damping * w) ** 2)

    hung = brentq(lambda w: 7.0 * (1.0 - w / no_load) - taken(w), 50.0, 100.0)
    speeds = [f.linkage.joint("shaft").velocity for f in told(page("sommerfeld"), 12.0)]
    assert np.mean(speeds[-2000:]) == pytest.approx(hung, rel=2e-3)
    assert hung < 100.0
    passed = [
        f.linkage.joint("shaft").velocity for f in told(page("sommerfeld"), 20.0, drives__motor__stall_torque_nm=11.0)
    ]
    beyond = brentq(lambda w: 11.0 * (1.0 - w / no_load) - taken(w), 120.0, no_load)
    assert np.mean(passed[-2000:]) == pytest.approx(beyond, rel=2e-3)


def circle_point(first, r1, second, r2, side):
    """Return the point at two distances from two points, on a side of their line."""
    first, second = np.array(first), np.array(second)
    d = np.linalg.norm(second - first)
    along = (d * d + r1 * r1 - r2 * r2) / (2.0 * d)
    x = (second - first) / d
    return first + along * x + side * math.sqrt(r1 * r1 - along * along) * np.array([-x[1], x[0]])


@pytest.mark.slow
def test_the_jaw_crusher_closes_by_the_circles_of_its_links():
    ours = told(page("jaw_crusher"), 1.5)
    angles = []
    for frame in ours[::5]:
        turned = frame.linkage.joint("shaft_bearing").position
        pin = 0.012 * np.array([math.cos(turned), math.sin(turned)])
        end = circle_point(pin, 0.6, (-0.35, -0.64), 0.352, 1.0)
        toe = circle_point(end, 0.352, (0.45, 0.15), 0.8, -1.0)
        x, y = toe - np.array([0.45, 0.15])
        angle = frame.linkage.joint("jaw_pivot").position
        assert 0.8 * math.remainder(angle - math.atan2(y, x), 2.0 * math.pi) == pytest.approx(0.0, abs=1e-11)
        angles.append(angle)
    assert 0.8 * np.ptp(angles) > 0.002
    work = ours[-1].linkage.memory["stone_work_j"]
    closing = sum(max(b - a, 0.0) for a, b in itertools.pairwise(angles))
    assert -work == pytest.approx(6000.0 * closing, rel=2e-2)


def reference_blows(count):
    """Return times and speeds of the hammer's blows by an integration of its own."""
    area, volume, outside, w = 8e-4, 3.2e-5, 101325.0, 60.0 * math.pi

    def piston(t):
        angle = math.pi + w * t
        return 0.02 * math.cos(angle) + math.sqrt(0.08**2 - (0.02 * math.sin(angle)) ** 2)

    state = {"vented": False}

    def closed(t, y):
        charge = volume if not state["vented"] else charge_at[0]
        now = volume + area * (y[0] - piston(t) - 0.04)
        return [y[1], area * outside * ((charge / now) ** 1.4 - 1.0) / 0.3]

    def port(t, y):
        return y[0] - 0.12

    def anvil(t, y):
        return y[0] - 0.125

    port.terminal = anvil.terminal = True
    charge_at, t, y, found = [volume], 0.0, [0.1, 0.0], []
    port.direction, anvil.direction = 1.0, 1.0
    while len(found) < count:
        way = solve_ivp(closed, (t, t + 1.0), y, events=port, rtol=1e-12, atol=1e-14, max_step=1e-3)
        t, y = way.t[-1], list(way.y[:, -1])
        speed = y[1]  # open: nothing acts
        t += 0.005 / speed
        found.append((t, speed))
        t += 0.005 / (0.2 * speed)
        y = [0.12 - 1e-15, -0.2 * speed]
        state["vented"], charge_at[0] = True, volume + area * (0.12 - piston(t) - 0.04)
    return found


def test_the_electropneumatic_hammer_strikes_as_an_integration_of_its_own():
    events = [e for f in told(page("electropneumatic_hammer"), 0.5) for e in f.linkage.events if e.kind == "impact"]
    expected = reference_blows(12)
    assert len(events) >= 12
    for event, (t, speed) in zip(events, expected, strict=False):
        assert event.time_s == pytest.approx(t, abs=1e-9)
        assert event.pre_velocity_m_per_s == pytest.approx(speed, rel=1e-8)
    assert speed > 9.0
