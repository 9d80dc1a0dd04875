# SPDX-License-Identifier: Apache-2.0
"""Derivatives by keys through impacts against differences in 60 digits: chatter, contacts together, a driven striker.

The reference walks from event to event by the closed form of each flight, and shares nothing with the product.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mpmath import cos, findroot, mp, mpf, pi, sin, sqrt

from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.runs import read_run
from mech_twin.measurements.tables import TableReader
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.identification.fit_problem import problem_of
from mech_twin.studies.identification.fit_runs import fit_run
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion

DIGITS, APART = 60, 25  # the reference moves a key by so small a part of itself: 10 to this power
EXACT = 1e-8  # of the largest derivative by the key
Reference = Callable[[dict[str, mpf], mpf], mpf]

BALL = """
name: ball
gravity_m_per_s2: [0.0, 0.0]
bodies:
  ball: {mass_kg: 1.0}
joints:
  guide: {kind: slider, between: [ground, ball], start_m: -0.5}
drives:
  weight: {kind: program, joint: guide, levels_n: [10.0, 10.0], period_s: 100.0, first_s: 50.0}
contacts:
  stop: {joint: guide, most_m: 0.0, restitution: 0.8}
"""
TWO_BALLS = """
name: two_balls
gravity_m_per_s2: [0.0, 0.0]
bodies:
  lower: {mass_kg: 2.0}
  upper: {mass_kg: 1.0}
joints:
  guide: {kind: slider, between: [ground, lower], start_m: -0.5}
  between: {kind: slider, between: [lower, upper], start_m: 0.0}
drives:
  weight: {kind: program, joint: guide, levels_n: [10.0, 10.0], period_s: 100.0, first_s: 50.0}
  press: {kind: program, joint: between, levels_n: [5.0, 5.0], period_s: 100.0, first_s: 50.0}
contacts:
  stop: {joint: guide, most_m: 0.0, restitution: 0.6}
  rests: {joint: between, most_m: 0.0, restitution: 0.0}
"""
CRANK = """
name: struck_by_a_crosshead
gravity_m_per_s2: [0.0, 0.0]
ground:
  points_m: {bearing: [0.0, 0.0]}
bodies:
  crank: {mass_kg: 5.0, inertia_kg_m2: 0.05, points_m: {pin: [0.05, 0.0]}}
  rod: {mass_kg: 1.0, inertia_kg_m2: 0.005, points_m: {end: [0.25, 0.0]}}
  crosshead: {mass_kg: 1.5}
  ball: {mass_kg: 1.0}
joints:
  crank_bearing: {kind: revolute, between: [ground.bearing, crank], start_deg: 180.0}
  crank_pin: {kind: revolute, between: [crank.pin, rod], start_deg: 180.0}
  wrist: {kind: revolute, between: [rod.end, crosshead]}
  crosshead_guide: {kind: slider, between: [ground.bearing, crosshead], start_m: 0.2}
  guide: {kind: slider, between: [ground.bearing, ball], start_m: 0.45}
drives:
  motor: {kind: constant_speed, joint: crank_bearing, speed_rpm: 100.0}
  weight: {kind: program, joint: guide, levels_n: [-10.0, -10.0], period_s: 100.0, first_s: 50.0}
contacts:
  blow: {point: ball, line: crosshead, normal_deg: 0.0, restitution: 0.7}
"""


def falls(mass: mpf, restitution: mpf, start: mpf, t: mpf) -> mpf:
    """Return where a ball is that a force of 10 N presses against a stop at 0."""
    a = mpf(10) / mass
    now, v = sqrt(-2 * start / a), a * sqrt(-2 * start / a)
    if t < now:
        return start + a * t * t / 2
    while v > mpf(10) ** -40:
        v = restitution * v
        if t < now + 2 * v / a:
            return -(v * (t - now) - a * (t - now) ** 2 / 2)
        now += 2 * v / a
    return mpf(0)


def ball(p: dict[str, mpf], t: mpf) -> mpf:
    return falls(p["bodies.ball.mass_kg"], p["contacts.stop.restitution"], p["joints.guide.start_m"], t)


def two_balls(p: dict[str, mpf], t: mpf) -> mpf:
    """Return where two balls are of which the upper one stays on the lower, in flight and in impacts."""
    together = p["bodies.lower.mass_kg"] + p["bodies.upper.mass_kg"]
    return falls(together, p["contacts.stop.restitution"], mpf("-0.5"), t)


def struck(p: dict[str, mpf], t: mpf) -> mpf:
    """Return where a ball is that a crosshead throws, the force bringing it back."""
    w, a, e = p["drives.motor.speed_rpm"] * pi / 30, -10 / p["bodies.ball.mass_kg"], p["contacts.blow.restitution"]
    r, rod = mpf("0.05"), mpf("0.25")

    def crosshead(at: mpf) -> mpf:
        return -r * cos(w * at) + sqrt(rod**2 - (r * sin(w * at)) ** 2)

    def speed(at: mpf) -> mpf:
        return w * r * sin(w * at) * (1 - r * cos(w * at) / sqrt(rod**2 - (r * sin(w * at)) ** 2))

    now, x, v = mpf(0), p["joints.guide.start_m"], mpf(0)
    while True:

        def gap(s: mpf, x: mpf = x, v: mpf = v, now: mpf = now) -> mpf:
            return x + v * s + a * s * s / 2 - crosshead(now + s)

        step = mpf("0.002")
        before = step
        while now + before < t and gap(before + step) > 0:
            before += step
        if now + before >= t:
            break
        met = findroot(gap, (before, before + step), solver="illinois", tol=mpf(10) ** -110)
        if now + met >= t:
            break
        x, v, now = x + v * met + a * met**2 / 2, v + a * met, now + met
        v = speed(now) - e * (v - speed(now))
    return x + v * (t - now) + a * (t - now) ** 2 / 2


def mass_with_two_levels(p: dict[str, mpf], t: mpf) -> mpf:
    """Return where the impact mass is: chatter and rest against the stop, released each period."""
    x, v, cycle = mpf("-0.5"), mpf(0), 0
    while True:
        begin = cycle * p["period_s"]
        changes = (begin + p["phase1_duration_s"], begin + p["period_s"])
        for force, end in zip((p["phase1_force_n"], p["phase2_force_n"]), changes, strict=True):
            x, v = _phase(x, v, force / p["mass_kg"], p["restitution"], min(end, t) - begin)
            if end >= t:
                return x
            begin = end
        cycle += 1


def _phase(x: mpf, v: mpf, a: mpf, e: mpf, left: mpf) -> tuple[mpf, mpf]:
    while True:
        if x == 0 and v == 0 and a > 0:
            return x, v
        square = v**2 - 2 * a * x
        wait = None
        if x < 0 or v < 0:
            if a > 0:
                wait = (sqrt(square) - v) / a
            elif v > 0 and square > 0:
                wait = -2 * x / (v + sqrt(square))
        if wait is None or wait >= left:
            return x + v * left + a * left**2 / 2, v + a * left
        left, x, v = left - wait, mpf(0), -e * (v + a * wait)
        if abs(v) < mpf(10) ** -40:
            v = mpf(0)


CASES: dict[str, tuple[str, str, float, float, dict[str, float], Reference]] = {
    "chatter of a ball": (
        BALL, "linkage.guide.position", 3.2, 0.01,
        {"bodies.ball.mass_kg": 1.0, "contacts.stop.restitution": 0.8, "joints.guide.start_m": -0.5}, ball,
    ),
    "one ball on another": (
        TWO_BALLS, "linkage.guide.position", 1.2, 0.01,
        {"bodies.lower.mass_kg": 2.0, "bodies.upper.mass_kg": 1.0, "contacts.stop.restitution": 0.6}, two_balls,
    ),
    "a ball on a crosshead": (
        CRANK, "linkage.guide.position", 1.2, 0.05,
        {
            "bodies.ball.mass_kg": 1.0, "contacts.blow.restitution": 0.7, "drives.motor.speed_rpm": 100.0,
            "joints.guide.start_m": 0.45,
        },
        struck,
    ),
    "rest and release": (
        "impact_mass", "linkage.mass.position", 0.4, 0.002,
        {
            "mass_kg": 1.0, "restitution": 0.3, "phase1_force_n": 1000.0, "phase2_force_n": -500.0,
            "phase1_duration_s": 0.035, "period_s": 0.05,
        },
        mass_with_two_levels,
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_derivatives_through_impacts_are_those_of_sixty_digits(case: str, tmp_path: Path) -> None:
    text, column, duration_s, step_s, keys, reference = CASES[case]
    machine = text
    if "\n" in text:
        (tmp_path / "machine.yaml").write_text(text, encoding="utf-8")
        machine = str(tmp_path / "machine.yaml")
    times = np.arange(1, round(duration_s / step_s)) * step_s
    lines = "".join(f"{t:.9g},{t:.9g}\n" for t in times.tolist())
    (tmp_path / "run.csv").write_text(f"time_s,x\n{lines}", encoding="utf-8")
    given = MeasurementMap.model_validate(
        {
            "machine": "page" if "\n" in text else machine,
            "time": {"column": "time_s"},
            "channels": [{"source": {"column": "x"}, "is": column}],
        }
    )
    run = fit_run(read_run(TableReader(tmp_path / "run.csv"), given), begin_known=True)
    problem = problem_of(IdentificationQuestion(machine, machine_parameters(machine), tuple(keys), cores=1), [run])
    unknowns = problem.unknowns
    comparison = problem.comparison(unknowns.start, np.array([1.0]))
    found = -problem.two_jacobians(unknowns.start, comparison)[0]
    told = found.any(axis=1)
    at = run.channels[0].times_s[comparison.masks[0][0]]
    with mp.workdps(DIGITS):
        instants = [mpf(round(t / 1e-3)) / 1000 for t in at.tolist()]
        exact = np.column_stack([_derivative(reference, keys, key, instants) for key in keys])
    assert not (exact.any(axis=1) & ~told).any()
    off = np.abs(found - exact).max(axis=0) / np.abs(exact).max(axis=0)
    assert off.max() < EXACT, dict(zip(keys, off.tolist(), strict=True))


def _derivative(reference: Reference, keys: dict[str, float], key: str, instants: list[mpf]) -> list[float]:
    """Return the derivatives by a key over its size."""
    values, apart = {each: mpf(repr(value)) for each, value in keys.items()}, mpf(10) ** -APART
    ends = [{**values, key: values[key] + side * apart * abs(values[key])} for side in (1, -1)]
    return [float((reference(ends[0], t) - reference(ends[1], t)) / (2 * apart)) for t in instants]
