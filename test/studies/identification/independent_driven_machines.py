# SPDX-License-Identifier: Apache-2.0
"""Roller former, breaker and three pages written a second time, as in `independent_machines`: driven, with blows.

Sources of the equations: the power of all bodies for drive moments; Newton's law for the ram and both shafts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import asin, cos, pi, sin, tan
from pathlib import Path

import numpy as np
from machines.mb10_breaker.breaker_reference import BreakerReference
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from studies.identification.independent_machines import Bench, Columns, G, NotThisMachineError, Sensor, impact_mass

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.parameters.load import machine_parameters

PAGES = Path(__file__).resolve().parents[3] / "config" / "pages"
RPM = np.pi / 30.0
LONGEST_STEP_S = 2e-3
SHORTEST_FLIGHT_S = 1e-7  # of the ram: a shorter one is the end of a series of blows
AT_ANVIL_M = 1e-14  # a ram that has just struck is no farther from the anvil


# ---- roller former at speed: two carts, an elastic shaft, a motor after Kloss behind a gear with a loss ----


def roller_former(p: Mapping[str, float], duration_s: float) -> Columns:
    """Return crank angle, speed of the drive and moment of the coupling; the load has a kink at each dead centre."""
    if not 0.3 < p["drive.efficiency"] <= 1.0:
        raise NotThisMachineError("a gear wins no power")
    r, ratio, eta, u = 0.2, 0.2 / 0.8, p["drive.efficiency"], 9.8
    half, offsets = 32.0, np.array([0.0, 0.5 * pi])
    first = (0.138 + p["drive.coupling_inertia_kg_m2"]) * 1.1 * u**2
    c, k, f = p["drive.stiffness_nm_per_rad"], p["drive.damping_nms_per_rad"], 0.008
    base = (2.0 * 2164.4444444444443 - 2249.9777777777776) * f + 2.0 * p["load_sets.table.roller_force_x_n"]

    def rates(_: float, y: np.ndarray, sides: list[float]) -> list[float]:
        crank, twist, speed, rate = map(float, y)
        inertia, slope, against = 2.0 * half * r**2, 0.0, 0.0
        for side, offset in zip(sides, offsets, strict=True):
            psi = crank + offset
            beta = asin(ratio * sin(psi))
            turn = ratio * cos(psi) / cos(beta)
            x1 = -r * sin(psi + beta) / cos(beta)
            x2 = -r * (cos(psi + beta) * (1.0 + turn) + sin(psi + beta) * tan(beta) * turn) / cos(beta)
            inertia += (197.33333333333334 + half) * x1 * x1
            slope += (197.33333333333334 + half) * x1 * x2
            against += side * base / (cos(beta) - side * f * sin(beta)) * r * sin(psi + beta)
        passed = c * twist + k * rate
        ahead = (passed - against - slope * speed**2) / inertia
        slip = 1.0 - (speed + rate) * u / (1000.0 * RPM)
        torque = 2.0 * 215.4 / (slip / 0.0933 + 0.0933 / slip) if slip != 0.0 else 0.0
        driven = torque * u * (eta if torque * (speed + rate) > 0.0 else 1.0 / eta)
        return [speed, rate, ahead, (driven - passed) / first - ahead]

    y, t, parts = np.array([0.0, 0.0, 0.97 * 1000.0 * RPM / u, 0.0]), 0.0, []
    while t < duration_s:
        middle = y[0] + 1e-7 + offsets
        sides = [1.0 if sin(angle) >= 0.0 else -1.0 for angle in middle]
        ahead = float(np.min((np.floor(middle / np.pi) + 1.0) * np.pi - offsets))
        parts.append(_run(rates, (t, duration_s), y, [lambda _, s, *a, at=ahead: at - s[0]], (sides,)))
        y, t = parts[-1].y[:, -1], float(parts[-1].t[-1])
        if y[2] < 0.6 * 1000.0 * RPM / u:
            raise NotThisMachineError("the motor is stalled")
    shown = _joined(parts)

    def columns(name: str, at_s: np.ndarray) -> np.ndarray:
        crank, twist, speed, rate = shown(at_s)
        by_name = {"linkage.crank.position": crank, "linkage.drive.velocity": speed + rate}
        return np.asarray(by_name[name] if name in by_name else c * twist + k * rate)

    return columns


# ---- slider-crank of a page, at constant speed, with friction of its piston ----


def slider_crank_page(p: Mapping[str, float], _: float) -> Columns:
    """Return crank angle, place of the piston and moment of the drive: the power of rod, piston and friction."""
    r, rod, w = 0.05, 0.2, p["drives.motor.speed_rpm"] * RPM
    m_r, i_r, m_p = p["bodies.rod.mass_kg"], p["bodies.rod.inertia_kg_m2"], p["bodies.piston.mass_kg"]

    def columns(name: str, at_s: np.ndarray) -> np.ndarray:
        th = w * at_s
        if name == "linkage.crank_bearing.position":
            return np.asarray(th)
        s, c = np.sin(th), np.cos(th)
        q = np.sqrt(rod**2 - (r * s) ** 2)  # along the guide, from pin to piston
        if name == "linkage.guide.position":
            return np.asarray(r * c + q)
        q1, q2 = -(r**2) * s * c / q, -(r**2) * (c**2 - s**2) / q - (r**2 * s * c) ** 2 / q**3
        x1, x2 = -r * s + q1, -r * c + q2
        cx1, cx2, cy1, cy2 = -r * s + 0.5 * q1, -r * c + 0.5 * q2, 0.5 * r * c, -0.5 * r * s
        b1, b2 = -r * c / q, r * s / q + r * c * q1 / q**2  # angle of the rod: its cosine is q / rod
        inert = m_p * x1 * x2 + m_r * (cx1 * cx2 + cy1 * cy2) + i_r * b1 * b2
        return np.asarray(w**2 * inert + m_r * G * cy1 + p["friction.piston_friction.coulomb_n"] * np.abs(x1))

    return columns


# ---- spring hammer of a page: a crosshead at constant speed, a spring, a ram with friction, an anvil ----


def spring_hammer_page(p: Mapping[str, float], duration_s: float) -> Columns:
    """Return crank angle, place of the ram and force of the spring."""
    r, rod, w = 0.05, 0.25, p["drives.motor.speed_rpm"] * RPM
    m, k, c = p["bodies.ram.mass_kg"], p["springs.spring.rate_n_per_m"], p["friction.ram_friction.coulomb_n"]
    anvil, e = 0.65, p["contacts.blow.restitution"]

    def crosshead(t: np.ndarray | float) -> np.ndarray:
        th = np.pi + w * np.asarray(t)
        return np.asarray(r * np.cos(th) + np.sqrt(rod**2 - (r * np.sin(th)) ** 2))

    def spring(t: np.ndarray | float, x: np.ndarray | float) -> np.ndarray:
        return np.asarray(k * (crosshead(t) + 0.4 - x))  # on the ram

    def moving(t: float, y: np.ndarray, sense: float) -> list[float]:
        return [y[1], (float(spring(t, y[0])) - sense * c) / m]

    t, y, parts = 0.0, np.array([0.6, 0.0]), []
    while t < duration_s:
        push = float(spring(t, y[0]))
        at_anvil = y[0] >= anvil and y[1] <= 0.0
        if y[1] == 0.0 and (abs(push) <= c or (at_anvil and push > 0.0)):
            leaves = [lambda s, z, *_: c - spring(s, z[0]), lambda s, z, *_: c + spring(s, z[0])]
            held = leaves[1:] if at_anvil else leaves
            parts.append(_run(lambda _t, _y: [0.0, 0.0], (t, duration_s), y, held, ()))
            t = float(parts[-1].t[-1])
            y = np.array([y[0], np.sign(spring(t, y[0])) * 1e-15])
            continue
        sense = np.sign(y[1]) if y[1] != 0.0 else np.sign(push)
        ends = [lambda _, z, s: anvil + AT_ANVIL_M - z[0], lambda _, z, s: s * z[1] if abs(z[1]) > 0.0 else 1e-300]
        parts.append(_run(moving, (t, duration_s), y, ends, (sense,)))
        met, y = parts[-1].t_events, parts[-1].y[:, -1]
        began, t = t, float(parts[-1].t[-1])
        if len(met[0]) and t < duration_s:
            y = np.array([anvil, -e * y[1] if t - began > SHORTEST_FLIGHT_S else 0.0])
        elif t < duration_s:
            y = np.array([y[0], 0.0])
    shown = _joined(parts)

    def columns(name: str, at_s: np.ndarray) -> np.ndarray:
        if name == "linkage.crank_bearing.position":
            return np.asarray(np.pi + w * at_s)
        x = shown(at_s)[0]
        return np.asarray(x if name == "linkage.ram_guide.position" else spring(at_s, x))

    return columns


# ---- the page of the impact mass ----

OF_THE_MASS = {
    "bodies.mass.mass_kg": "mass_kg",
    "contacts.stop.restitution": "restitution",
    "drives.generator.period_s": "period_s",
    "drives.generator.first_s": "phase1_duration_s",
}


def impact_mass_page(p: Mapping[str, float], duration_s: float) -> Columns:
    """Return the place of the mass by the names of its page."""
    given = {"stop_position_m": 0.0, "initial_position_m": -0.5, "initial_velocity_m_per_s": 0.0}
    given |= {"phase1_force_n": 1000.0, "phase2_force_n": -500.0} | {
        OF_THE_MASS[key]: value for key, value in p.items()
    }
    shown = impact_mass(given, duration_s)
    return lambda _, at_s: shown("linkage.mass.position", at_s)


# ---- breaker: the package's own judge of its coupled run, which shares its parameters and no equation ----

FINE_S = 1e-4


def mb10_breaker(p: Mapping[str, float], duration_s: float) -> Columns:
    """Return angle and rate of crank and body, and the motor's torque."""
    try:
        parameters = machine_parameters("mb10_breaker", None, p)
    except ConfigurationError as error:
        raise NotThisMachineError(str(error)) from error
    reference, times = BreakerReference(parameters), FINE_S * np.arange(round(duration_s / FINE_S) + 2)
    motion = reference.run(times)
    states = motion.samples
    for blow, impulse in motion.blows:  # the reference holds where the striker does not catch up with the tool
        after = np.flatnonzero((times > blow + FINE_S) & (times < blow + impulse / parameters.tool.wall_force_n))
        since = times[after] - blow
        tool = (impulse * since - 0.5 * parameters.tool.wall_force_n * since**2) / p["tool.mass_kg"]
        if any(reference.gap(q, phi) < -x for (q, _, phi, _), x in zip(states[after], tool, strict=True)):
            raise NotThisMachineError("the striker catches up with the tool")
    gear, turning = parameters.gear.ratio, states[:, 1] - (states[:, 3] if parameters.drive_mount == "frame" else 0.0)

    def columns(name: str, at_s: np.ndarray) -> np.ndarray:
        if name == "motor.rotor.effort":
            return np.array([reference.motor_torque(gear * u) for u in np.interp(at_s, times, turning)])
        place = 0 if ".crank." in name else 2
        if name.endswith("velocity"):
            return np.interp(at_s, times, states[:, place + 1])
        return np.asarray(CubicHermiteSpline(times, states[:, place], states[:, place + 1])(at_s))

    return columns


def _run(
    rates: Callable[..., list[float]],
    span: tuple[float, float],
    y: np.ndarray,
    ends: list[Callable[..., float]],
    given: tuple[object, ...],
) -> object:
    """Return scipy's solution up to the first of the ends, which count as they fall."""
    for end in ends:
        end.terminal, end.direction = True, -1.0  # type: ignore[attr-defined]
    return solve_ivp(
        rates, span, y, "DOP853", dense_output=True, rtol=1e-11, atol=1e-13, events=ends, args=given or None,
        max_step=LONGEST_STEP_S,
    )  # fmt: skip


def _joined(parts: list[object]) -> Callable[[np.ndarray], np.ndarray]:
    """Return the states of consecutive solutions as a function of time."""
    ends = np.array([part.t[-1] for part in parts])

    def states(at_s: np.ndarray) -> np.ndarray:
        own = np.minimum(np.searchsorted(ends, at_s), len(parts) - 1)
        found = np.empty((len(parts[0].y), len(at_s)))
        for place in np.unique(own):
            found[:, own == place] = parts[place].sol(at_s[own == place])
        return found

    return states


DRIVEN_BENCHES = {
    bench.label: bench
    for bench in (
        Bench(
            "roller_former",
            "roller_former",
            2.0,
            {
                "drive.efficiency": 0.9, "drive.stiffness_nm_per_rad": 110000.0, "drive.damping_nms_per_rad": 8000.0,
                "drive.coupling_inertia_kg_m2": 0.32, "load_sets.table.roller_force_x_n": 1769.3333333333333,
            },
            (
                "drive.efficiency", "drive.stiffness_nm_per_rad", "drive.damping_nms_per_rad",
                "drive.coupling_inertia_kg_m2", "load_sets.table.roller_force_x_n",
            ),
            (
                Sensor("linkage.crank.position", 300.0, 1e-3, zero=1.0),
                Sensor("linkage.drive.velocity", 300.0, 0.02, lag_s=0.004),
                Sensor("forces.coupling_moment_nm", 300.0, 10.0),
            ),
            roller_former,
            {"start.speed_fraction": 0.97, "start.load_from_fraction": 0.0},
        ),
        Bench(
            "page: slider_crank",
            str(PAGES / "slider_crank.yaml"),
            1.0,
            {
                "bodies.rod.mass_kg": 1.0, "bodies.rod.inertia_kg_m2": 0.004, "bodies.piston.mass_kg": 1.5,
                "friction.piston_friction.coulomb_n": 20.0, "drives.motor.speed_rpm": 300.0,
            },
            (
                "bodies.rod.mass_kg", "bodies.piston.mass_kg", "friction.piston_friction.coulomb_n",
                "drives.motor.speed_rpm",
            ),
            (
                Sensor("linkage.crank_bearing.position", 400.0, 0.002, zero=1.0),
                Sensor("linkage.guide.position", 400.0, 1e-4, zero=0.02, lag_s=0.004),
                Sensor("motor.motor.effort", 500.0, 0.05),
            ),
            slider_crank_page,
        ),
        Bench(
            "page: spring_hammer",
            str(PAGES / "spring_hammer.yaml"),
            1.2,
            {
                "bodies.ram.mass_kg": 4.0, "springs.spring.rate_n_per_m": 8000.0,
                "friction.ram_friction.coulomb_n": 10.0, "contacts.blow.restitution": 0.3,
                "drives.motor.speed_rpm": 300.0,
            },
            (
                "bodies.ram.mass_kg", "springs.spring.rate_n_per_m", "contacts.blow.restitution",
                "drives.motor.speed_rpm",
            ),
            (
                Sensor("linkage.crank_bearing.position", 500.0, 0.002, zero=1.0),
                Sensor("linkage.ram_guide.position", 1000.0, 5e-5, zero=0.01, lag_s=0.003),
                Sensor("forces.spring_force_n", 1000.0, 2.0),
            ),
            spring_hammer_page,
        ),
        Bench(
            "page: impact_mass",
            str(PAGES / "impact_mass.yaml"),
            0.8,
            {
                "bodies.mass.mass_kg": 1.0, "contacts.stop.restitution": 0.3, "drives.generator.period_s": 0.05,
                "drives.generator.first_s": 0.035,
            },
            tuple(OF_THE_MASS),
            (Sensor("linkage.guide.position", 1000.0, 8e-5, zero=0.02, lag_s=0.002),),
            impact_mass_page,
        ),
        Bench(
            "mb10_breaker",
            "mb10_breaker",
            0.8,
            {
                "body.spring_rate_n_per_m": 53300.0, "body.preload_deflection_m": 0.0139, "body.inertia_kg_m2": 6.0,
                "body.restitution": 0.4, "tool.overtravel_m": 0.003, "linkage.crank_inertia_kg_m2": 0.3,
                "tool.mass_kg": 10.0, "tool.restitution": 0.35,
            },
            (
                "body.spring_rate_n_per_m", "body.preload_deflection_m", "body.inertia_kg_m2", "body.restitution",
                "tool.overtravel_m", "linkage.crank_inertia_kg_m2", "tool.mass_kg", "tool.restitution",
            ),
            (
                Sensor("linkage.crank.position", 400.0, 0.002, zero=1.0),
                Sensor("linkage.body.position", 400.0, 2e-5, zero=0.01),
                Sensor("linkage.body.velocity", 400.0, 2e-3, lag_s=0.004),
                Sensor("motor.rotor.effort", 400.0, 0.05),
            ),
            mb10_breaker,
            {"coupling.step_s": 5e-4},
        ),
    )
}  # fmt: skip
