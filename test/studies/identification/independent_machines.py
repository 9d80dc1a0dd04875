# SPDX-License-Identifier: Apache-2.0
"""Four machines written a second time from their equations, and measured runs of them with hidden numbers.

Nothing of the product is imported: motions are closed forms, or scipy's integration where there is none.  What a run
of `HiddenDraw` shows - keys off by up to a half, zeros, lags and noise that no map tells - nobody has fitted before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar

G = 9.80665
Columns = Callable[[str, np.ndarray], np.ndarray]


class NotThisMachineError(ValueError):
    """The numbers are those of no machine that can be assembled, turned or shown."""


@dataclass(frozen=True)
class Sensor:
    """One channel of a stand: what it shows, how often, with which noise, and what of it is hidden."""

    column: str
    rate_hz: float
    sigma: float
    zero: float = 0.0  # a hidden zero is drawn from +- this
    lag_s: float = 0.0  # a hidden lag is drawn from 0 to this


@dataclass(frozen=True)
class Bench:
    """A machine, its true numbers as configured, those that are hidden, and its sensors."""

    label: str
    machine: str
    duration_s: float
    configured: Mapping[str, float]
    keys: tuple[str, ...]
    sensors: tuple[Sensor, ...]
    motion: Callable[[Mapping[str, float], float], Columns]
    settings: Mapping[str, float] = field(default_factory=dict)  # of the machine, known to the fit


@dataclass(frozen=True)
class HiddenDraw:
    """One measured run: the truth, and samples by column."""

    bench: Bench
    seed: int
    true: dict[str, float]
    samples: dict[str, tuple[np.ndarray, np.ndarray]] = field(repr=False)

    def map_tree(self) -> dict[str, Any]:
        """Return the map of the run: zeros and lags are left free where the stand hides some; no noise is told."""
        channels = []
        for sensor in self.bench.sensors:
            channel: dict[str, Any] = {"source": {"column": sensor.column}, "is": sensor.column}
            channel |= {"zero": "free"} if sensor.zero else {}
            channel |= {"lag_s": "free"} if sensor.lag_s else {}
            channels.append(channel)
        machine = "page" if self.bench.machine.endswith(".yaml") else self.bench.machine
        return {"machine": machine, "time": {"column": "time_s"}, "channels": channels}

    def write(self, path: Path) -> None:
        """Write the run as a table; cells of channels without a sample at a time are empty."""
        times = np.unique(np.concatenate([stamps for stamps, _ in self.samples.values()]))
        cells = np.full((len(times), len(self.samples)), "", dtype=object)
        for place, (stamps, values) in enumerate(self.samples.values()):
            cells[np.searchsorted(times, stamps), place] = [f"{value:.9g}" for value in values]
        lines = [",".join(["time_s", *self.samples])]
        lines += [f"{time:.9g},{','.join(row)}" for time, row in zip(times.tolist(), cells.tolist(), strict=True)]
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def hidden_draw(bench: Bench, seed: int, spread: float = 0.5) -> HiddenDraw:
    """Return a run of a machine whose keys are off by up to ``spread`` of themselves; impossible draws are left out."""
    random = np.random.default_rng([seed, *bench.label.encode()])
    for _ in range(10_000):
        true = {key: bench.configured[key] * (1.0 + spread * random.uniform(-1.0, 1.0)) for key in bench.keys}
        try:
            columns = bench.motion({**bench.configured, **true}, bench.duration_s)
            samples = {}
            for sensor in bench.sensors:
                stamps = np.arange(1, round(bench.duration_s * sensor.rate_hz)) / sensor.rate_hz
                lag, zero = sensor.lag_s * random.uniform(), sensor.zero * random.uniform(-1.0, 1.0)
                shown = columns(sensor.column, np.maximum(stamps - lag, 0.0)) + zero
                samples[sensor.column] = (stamps, shown + sensor.sigma * random.standard_normal(len(stamps)))
        except NotThisMachineError:
            continue
        return HiddenDraw(bench, seed, true, samples)
    raise NotThisMachineError(f"{bench.label}: no draw of {seed} can be built")


# ---- impact mass: parabolas between impacts, m x'' = P(t), v+ = -R v- at the stop ----

SHORTEST_FLIGHT = 1e-7  # of the period: shorter ones are the end of a series of impacts


def impact_mass(p: Mapping[str, float], duration_s: float) -> Columns:
    """Return position, speed and driving force of a mass under two levels of force, with a stop."""
    pieces: list[tuple[float, float, float, float]] = []  # time, gap to the stop, speed, acceleration from then on
    levels = (p["phase1_force_n"], p["phase2_force_n"])
    period, first = p["period_s"], p["phase1_duration_s"]
    if not 0.0 < first < period:
        raise NotThisMachineError("the first phase fills the period")
    time, speed = 0.0, p["initial_velocity_m_per_s"]
    gap = p["stop_position_m"] - p["initial_position_m"]
    cycle = 0
    while time < duration_s:
        for level, end in zip(levels, (cycle * period + first, (cycle + 1) * period), strict=True):
            a = level / p["mass_kg"]
            while True:
                resting = gap <= 0.0 and a >= 0.0 and 2.0 * abs(speed) <= SHORTEST_FLIGHT * period * abs(a)
                if resting:
                    gap, speed = 0.0, 0.0
                    pieces.append((time, 0.0, 0.0, 0.0))
                    time = end
                    break
                pieces.append((time, gap, speed, a))
                flight = _flight_to_stop(gap, speed, a)
                if time + flight >= end:
                    passed = end - time
                    gap, speed = max(gap - speed * passed - 0.5 * a * passed**2, 0.0), speed + a * passed
                    time = end
                    break
                time, gap = time + flight, 0.0
                speed = -p["restitution"] * (speed + a * flight)
        cycle += 1
    began, gaps, speeds, rates = np.array(pieces).T

    def columns(name: str, at_s: np.ndarray) -> np.ndarray:
        place = np.searchsorted(began, at_s, side="right") - 1
        passed = at_s - began[place]
        if name == "linkage.mass.position":
            away = gaps[place] - speeds[place] * passed - 0.5 * rates[place] * passed**2
            return np.asarray(p["stop_position_m"] - away)
        if name == "linkage.mass.velocity":
            return np.asarray(speeds[place] + rates[place] * passed)
        return np.where(at_s % period < first, *levels)

    return columns


def _flight_to_stop(gap: float, speed: float, a: float) -> float:
    """Return how long the mass flies until it meets the stop, infinite where it does not."""
    square = speed**2 + 2.0 * a * gap
    if square < 0.0 or (speed <= 0.0 and a <= 0.0):
        return np.inf
    before = square**0.5
    if speed >= 0.0:
        return 2.0 * gap / (speed + before) if gap > 0.0 else (0.0 if speed > 0.0 else np.inf)
    return (before - speed) / a


# ---- vibration crank at constant speed ----


def vibration_crank(p: Mapping[str, float], _: float) -> Columns:
    """Return crank angle, slider height and driving moment of a slider-crank that turns evenly."""
    r, rod, w = p["crank_m"], p["rod_m"], p["drive.speed_rpm"] * np.pi / 30.0
    if r > 0.8 * rod:
        raise NotThisMachineError("the rod is too short")
    m_s = p["masses.tree_kg"] + p["masses.stand_kg"] + p["masses.extra_kg"]
    m_s += 0.5 * (p["masses.boom_kg"] + p["masses.rod_kg"])
    unbalance = p["masses.rotating_kg"] * r - p["counterweight.mass_kg"] * p["counterweight.radius_m"]

    def columns(name: str, at_s: np.ndarray) -> np.ndarray:
        th = w * at_s
        if name == "linkage.crank.position":
            return np.asarray(th)
        x, along = r * np.cos(th), np.sqrt(rod**2 - (r * np.cos(th)) ** 2)
        if name == "linkage.slider.position":
            return np.asarray(r * np.sin(th) + along)
        slope_x, bend_x = -r * np.sin(th), -r * np.cos(th)
        slope = r * np.cos(th) - x * slope_x / along
        bend = -r * np.sin(th) - (slope_x**2 + x * bend_x) / along - (x * slope_x) ** 2 / along**3
        return np.asarray(
            m_s * (w**2 * slope * bend + G * slope) + p["working_force_n"] * slope + unbalance * G * np.cos(th)
        )

    return columns


# ---- compaction press at constant speed ----


def compaction_press(p: Mapping[str, float], _: float) -> Columns:  # noqa: PLR0915 (its equations, in their order)
    """Return the angles of crank, plate and pendulum, and the driving moment, of a four-bar that turns evenly."""
    r, plate, pendulum = (p[f"linkage.{name}_m"] for name in ("crank", "coupler", "pendulum"))
    pivot = np.array([p["linkage.pivot_x_m"], p["linkage.pivot_y_m"]])
    far = float(np.hypot(*pivot))
    # 20 mm and more to spare: close to a dead point the moment has no end
    if r + far > plate + pendulum - 0.02 or abs(far - r) < abs(plate - pendulum) + 0.02 or r > 0.8 * min(plate, far):
        raise NotThisMachineError("the linkage does not turn")
    w = p["drive.speed_rpm"] * np.pi / 30.0
    mass = [p[f"links.{name}.mass_kg"] for name in ("plate", "pendulum")]
    inertia = [p[f"links.{name}.inertia_kg_m2"] for name in ("plate", "pendulum")]
    centroid = [p[f"links.{name}.centroid_along_m"] for name in ("plate", "pendulum")]
    loaded = p["working_force.application_from_a_m"]

    def angles(f: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a = np.array([r * np.cos(f), r * np.sin(f)])
        d = pivot[:, None] - a
        square = np.sum(d**2, axis=0)
        share = (plate**2 - pendulum**2 + square) / (2.0 * square)
        across = np.sqrt(plate**2 / square - share**2)
        b = a + share * d + across * np.array([d[1], -d[0]])
        u, v = b - a, b - pivot[:, None]
        return np.unwrap(np.arctan2(u[1], u[0])), np.unwrap(np.arctan2(v[1], v[0]))

    def loaded_height(f: np.ndarray) -> np.ndarray:
        return np.asarray(r * np.sin(f) + loaded * np.sin(angles(f)[0]))

    turn = np.linspace(0.0, 2.0 * np.pi, 721)
    heights = loaded_height(turn)
    if np.diff(np.sign(np.diff(heights))).astype(bool).sum() > 3:
        raise NotThisMachineError("the loaded point turns back more than once a stroke")
    top = _extreme(lambda f: -float(loaded_height(np.array([f]))[0]), turn[heights.argmax()])
    bottom = _extreme(lambda f: float(loaded_height(np.array([f]))[0]), turn[heights.argmin()])
    high, low = (float(loaded_height(np.array([f]))[0]) for f in (top, bottom))
    met = high - p["working_force.contact_fraction"] * (high - low)

    def columns(name: str, at_s: np.ndarray) -> np.ndarray:
        f = w * at_s
        if name == "linkage.crank.position":
            return np.asarray(f)
        g_, p_ = angles(f)  # a few degrees from sample to sample: they do not jump by a turn
        if name == "linkage.plate.position":
            return g_
        if name == "linkage.pendulum.position":
            return p_
        u, v = _unit(g_) * plate, _unit(p_) * pendulum
        ku, kv, ka = _turned(_unit(g_)), _turned(_unit(p_)), _turned(_unit(f)) * r
        # V_A + w2 k u = w3 k v, and the same of the accelerations
        det = u[0] * v[1] - u[1] * v[0]
        w2 = -np.sum(ka * v, axis=0) / det
        w3 = -np.sum(ka * u, axis=0) / det
        t = -_unit(f) * r - w2**2 * u + w3**2 * v
        e2, e3 = -np.sum(t * v, axis=0) / det, -np.sum(t * u, axis=0) / det
        s2 = ka + w2 * centroid[0] * ku
        s2_rate = -_unit(f) * r + e2 * centroid[0] * ku - w2**2 * centroid[0] * _unit(g_)
        s3, s3_rate = w3 * centroid[1] * kv, e3 * centroid[1] * kv - w3**2 * centroid[1] * _unit(p_)
        power = mass[0] * np.sum(s2 * s2_rate, axis=0) + inertia[0] * w2 * e2
        power = power + mass[1] * np.sum(s3 * s3_rate, axis=0) + inertia[1] * w3 * e3
        height = r * np.sin(f) + loaded * np.sin(g_)
        rate = (ka + w2 * loaded * ku)[1]
        down = (f - top) % (2.0 * np.pi) <= (bottom - top) % (2.0 * np.pi)
        share = np.clip((met - height) / (met - low), 0.0, 1.0) ** p["working_force.exponent"]
        force = p["working_force.peak_n"] * np.where(down, share, 0.0)
        weights = G * (mass[0] * s2[1] + mass[1] * s3[1])
        return np.asarray(w**2 * power + weights - force * rate)

    return columns


def _unit(angle: np.ndarray) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def _turned(vector: np.ndarray) -> np.ndarray:
    return np.array([-vector[1], vector[0]])


def _extreme(of: Callable[[float], float], near: float) -> float:
    return float(minimize_scalar(of, (near - 0.02, near, near + 0.02), tol=1e-12).x)


# ---- winding drum: unwinding, by conservation of area ----


def winding_drum(p: Mapping[str, float], duration_s: float) -> Columns:
    """Return drum angle, yarn speed and dynamic torque of a package that unwinds from rest."""
    e, rate, most = p["eccentricity_m"], p["yarn_acceleration_m_per_s2"], p["yarn_speed_m_per_s"]
    layer = p["layer_thickness_m"] / (2.0 * np.pi)

    def yarn(t: np.ndarray | float) -> Any:
        return np.minimum(rate * np.asarray(t), most)

    def rates(t: float, state: np.ndarray) -> list[float]:
        angle, radius = state
        speed = float(yarn(t))
        return [speed / (radius + e * np.cos(angle)), -layer * speed / radius]

    ends = [min(most / rate, duration_s), duration_s]
    parts, state, began = [], np.array([0.0, p["package_radius_m"]]), 0.0
    for end in ends:
        if end > began:
            parts.append(solve_ivp(rates, (began, end), state, "DOP853", dense_output=True, rtol=1e-11, atol=1e-13))
            state, began = parts[-1].y[:, -1], end
    if state[1] < 1.2 * p["core_radius_m"]:
        raise NotThisMachineError("the package is used up")

    def columns(name: str, at_s: np.ndarray) -> np.ndarray:
        state = np.where(at_s <= ends[0], parts[0].sol(np.minimum(at_s, ends[0])), parts[-1].sol(at_s))
        angle, radius = state
        if name == "linkage.drum.position":
            return np.asarray(angle)
        speed = yarn(at_s)
        if name == "linkage.yarn.velocity":
            return np.asarray(speed)
        arm = radius + e * np.cos(angle)
        acceleration = np.where(at_s < most / rate, rate, 0.0)
        turning = acceleration / arm + speed**2 * layer / (arm**2 * radius) + speed**2 * e * np.sin(angle) / arm**3
        heavy = p["package_density_kg_per_m3"] * p["package_width_m"]
        inertia = p["drum_inertia_kg_m2"] + 0.5 * np.pi * heavy * (radius**4 - p["core_radius_m"] ** 4)
        return np.asarray(inertia * turning - np.pi * heavy * speed**2 * layer * radius**2 / arm)

    return columns


BENCHES = {
    bench.label: bench
    for bench in (
        Bench(
            "impact_mass",
            "impact_mass",
            0.8,
            {
                "mass_kg": 1.0, "stop_position_m": 0.0, "restitution": 0.3, "period_s": 0.05,
                "phase1_duration_s": 0.035, "phase1_force_n": 1000.0, "phase2_force_n": -500.0,
                "initial_position_m": -0.5, "initial_velocity_m_per_s": 0.0,
            },
            ("mass_kg", "restitution", "phase1_force_n", "phase2_force_n", "phase1_duration_s"),
            (
                Sensor("linkage.mass.position", 2000.0, 8e-5, zero=0.02, lag_s=0.002),
                Sensor("forces.drive_force_n", 2000.0, 5.0),
            ),
            impact_mass,
        ),
        Bench(
            "impact_mass, position alone",
            "impact_mass",
            0.8,
            {
                "mass_kg": 1.0, "stop_position_m": 0.0, "restitution": 0.3, "period_s": 0.05,
                "phase1_duration_s": 0.035, "phase1_force_n": 1000.0, "phase2_force_n": -500.0,
                "initial_position_m": -0.5, "initial_velocity_m_per_s": 0.0,
            },
            ("restitution", "phase1_force_n", "phase2_force_n", "phase1_duration_s", "period_s"),
            (Sensor("linkage.mass.position", 1000.0, 8e-5, zero=0.02, lag_s=0.002),),
            impact_mass,
        ),
        Bench(
            "vibration_crank",
            "vibration_crank",
            2.4,
            {
                "masses.tree_kg": 50.0, "masses.stand_kg": 50.5, "masses.boom_kg": 33.4, "masses.rod_kg": 3.1,
                "masses.extra_kg": 8.0, "masses.rotating_kg": 7.55, "crank_m": 0.126, "rod_m": 0.504,
                "working_force_n": 0.0, "counterweight.radius_m": 0.175, "counterweight.mass_kg": 51.11,
                "drive.speed_rpm": 150.0,
            },
            ("crank_m", "rod_m", "masses.tree_kg", "counterweight.radius_m", "drive.speed_rpm"),
            (
                Sensor("linkage.crank.position", 200.0, 0.002, zero=1.0),
                Sensor("linkage.slider.position", 150.0, 3e-4, zero=0.05, lag_s=0.006),
                Sensor("motor.motor.effort", 200.0, 2.0),
            ),
            vibration_crank,
        ),
        Bench(
            "compaction_press",
            "compaction_press",
            2.0,
            {
                "linkage.crank_m": 0.06, "linkage.coupler_m": 0.5, "linkage.pendulum_m": 0.3,
                "linkage.pivot_x_m": 0.5, "linkage.pivot_y_m": 0.24,
                "links.plate.mass_kg": 40.0, "links.plate.inertia_kg_m2": 40.0 * 0.5**2 / 12.0,
                "links.plate.centroid_along_m": 0.25, "links.pendulum.mass_kg": 5.0,
                "links.pendulum.inertia_kg_m2": 5.0 * 0.3**2 / 12.0, "links.pendulum.centroid_along_m": 0.15,
                "working_force.peak_n": 10000.0, "working_force.application_from_a_m": 0.25,
                "working_force.contact_fraction": 0.5, "working_force.exponent": 1.0, "drive.speed_rpm": 300.0,
            },
            (
                "linkage.crank_m", "linkage.coupler_m", "linkage.pendulum_m", "links.plate.mass_kg",
                "working_force.peak_n", "drive.speed_rpm",
            ),
            (
                Sensor("linkage.crank.position", 400.0, 0.001, zero=1.0),
                Sensor("linkage.plate.position", 400.0, 3e-4, lag_s=0.004),
                Sensor("linkage.pendulum.position", 250.0, 3e-4, zero=0.2),
                Sensor("motor.motor.effort", 500.0, 1.0),
            ),
            compaction_press,
        ),
        Bench(
            "winding_drum",
            "winding_drum",
            16.0,
            {
                "package_radius_m": 0.3, "core_radius_m": 0.08, "package_width_m": 1.2, "eccentricity_m": 0.004,
                "layer_thickness_m": 0.0006, "yarn_speed_m_per_s": 5.0, "yarn_acceleration_m_per_s2": 0.4,
                "package_density_kg_per_m3": 450.0, "drum_inertia_kg_m2": 0.5,
            },
            (
                "eccentricity_m", "layer_thickness_m", "yarn_speed_m_per_s", "yarn_acceleration_m_per_s2",
                "package_density_kg_per_m3",
            ),
            (
                Sensor("linkage.drum.position", 100.0, 0.005, zero=1.0),
                Sensor("forces.dynamic_torque_nm", 100.0, 0.1),
                Sensor("linkage.yarn.velocity", 100.0, 0.01, lag_s=0.05),
            ),
            winding_drum,
        ),
    )
}  # fmt: skip
