# SPDX-License-Identifier: Apache-2.0
"""A synthetic four-bar with a hammered body: samples that move as a real machine's do, without one."""

from __future__ import annotations

import math
from collections.abc import Iterator

from mech_twin.samples import (
    BodySample,
    Drawing,
    Event,
    ForceSample,
    Frame,
    LinkageSample,
    MotorSample,
    Named,
    Shape,
    Wrench,
)

STEP_S = 0.001
CRANK_M, COUPLER_M, ROCKER_M, GROUND_M = 0.03, 0.20, 0.08, 0.20
RATE_RAD_PER_S = 62.8
PERIOD_S = 0.1
JOINTS = ("crank", "coupler", "rocker")
PINS = ("A", "B", "C", "D")
STEEL, STRIKER, BRIGHT = (70, 80, 95), (196, 78, 40), (30, 110, 180)


def rocker_pin(crank_rad: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the crank pin and the rocker pin at a crank angle."""
    bx, by = CRANK_M * math.cos(crank_rad), CRANK_M * math.sin(crank_rad)
    dx, dy = GROUND_M - bx, -by
    span = math.hypot(dx, dy)
    along = (COUPLER_M**2 - ROCKER_M**2 + span**2) / (2.0 * span)
    across = math.sqrt(COUPLER_M**2 - along**2)
    cx, cy = bx + (along * dx - across * dy) / span, by + (along * dy + across * dx) / span
    return (bx, by), (cx, cy)


def frame(step: int) -> Frame:
    """Return all samples of a step; every second role value is a smooth function of the crank angle."""
    time_s = step * STEP_S
    crank = RATE_RAD_PER_S * time_s
    speed = RATE_RAD_PER_S * (1.0 + 0.02 * math.sin(crank))
    (bx, by), (cx, cy) = rocker_pin(crank)
    coupler, rocker = math.atan2(cy - by, cx - bx), math.atan2(cy, cx - GROUND_M)
    blow = math.exp(-(((time_s % PERIOD_S) / 0.004) ** 2))
    motor = MotorSample(step, time_s, ("rotor",), (2.37 * crank,), (2.37 * speed,), (4.0 - 2.0 * math.sin(crank),), 1.0)
    linkage = LinkageSample(
        step,
        time_s,
        JOINTS,
        (crank, coupler, rocker),
        (speed, 9.0 * math.sin(crank), 22.0 * math.sin(crank + 0.4)),
        (8.0 + 3.0 * math.cos(crank), 0.0, 0.0),
        0,
        1.0,
        Named(),
        Named(
            ("loop_closure_m", "power_w"), (1e-16 * (1.0 + abs(math.sin(crank))), 1e-12 * (1.0 + math.cos(crank) ** 2))
        ),
    )
    wrenches = tuple(
        Wrench(600.0 * math.cos(crank + place) + 300.0 * place + 900.0 * blow, 400.0 * math.sin(crank + place), 0.0)
        for place in range(len(PINS))
    )
    forces = ForceSample(
        step,
        time_s,
        PINS,
        wrenches,
        Named(("drive_torque_nm", "wall_force_n"), (8.0 + 5.0 * math.sin(crank), 50.0 * blow)),
        60.0 * math.sin(crank) * blow,
        Named(("torque_routes",), (1e-13,)),
    )
    flight = (time_s % PERIOD_S) / PERIOD_S
    gap = 0.0054 * max(0.0, math.sin(math.pi * flight / 0.7)) if flight < 0.7 else 0.0
    rate = 0.24 * math.cos(math.pi * flight / 0.7) if flight < 0.7 else 0.0
    body = BodySample(
        step, time_s, ("body",), (gap,), (rate,), (-148.0 - 2132.0 * gap,), 0, 741.0 + 10660.0 * gap, Named(), Named()
    )
    return Frame(linkage, motor, forces, body)


def drawing(step: int) -> Drawing:
    """Return the mechanism drawn at a step."""
    time_s = step * STEP_S
    b, c = rocker_pin(RATE_RAD_PER_S * time_s)
    d = (GROUND_M, 0.0)
    angle = math.atan2(c[1], c[0] - GROUND_M)
    head = (GROUND_M + 0.2 * math.cos(angle), 0.2 * math.sin(angle))
    shapes = (
        Shape("ground", "line", ((-0.05, -0.02), (0.30, -0.02)), (150, 150, 150), 0.004),
        Shape("coupler", "line", (b, c), BRIGHT, 0.010),
        Shape("crank", "line", ((0.0, 0.0), b), STEEL, 0.014),
        Shape("rocker", "line", (d, head), STRIKER, 0.014),
        Shape("pins", "points", ((0.0, 0.0), b, c, d), (20, 20, 20), 0.014),
        Shape("force on D", "arrow", (d, (d[0] + 0.05 * math.cos(10 * time_s), -0.05)), (0, 140, 90), 0.005),
    )
    return Drawing(step, time_s, shapes)


def events(step: int) -> Iterator[Event]:
    """Yield the blow and the return of each period in the step in which they fall."""
    phase = step % round(PERIOD_S / STEP_S)
    cycle = step // round(PERIOD_S / STEP_S)
    if phase == 1:
        yield Event((step - 0.5) * STEP_S, "blow", "tool", 1.58, -0.55, 20.9, cycle)
    if phase == 71:
        yield Event((step - 0.25) * STEP_S, "return", "collar", 0.106, -0.042, 0.9, cycle)


def metrics(step: int) -> dict[str, float]:
    """Return the metrics of a run."""
    return {
        "blow_rate_hz": 10.0,
        "blow_energy_j": 18.8,
        "gap_at_blow_m": 0.0,
        "return_speed_m_per_s": 0.1053,
        "maximum_pressing_force_n": 798.2,
        "rest_force_n": 741.0,
        "contact_share": 0.28,
        "impacts_per_cycle": 1.0,
        "mean_power_w": 316.4,
        "cycles": step // 100,
    }
