"""Design problem of the press: objectives and constraint margins of many designs (r, l, h, R) at once.

A design is sampled at 72 crank positions; the layer's law, the stroke and the energy are those of the samples.  The
plate is as long as the bearings are apart (R1 = l), masses grow with length, the load acts at mid-plate.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from mech_twin.kernel import kernel, parallel_kernel
from mech_twin.machines.compaction_press.dynamics import FREE, Press, press_reduced
from mech_twin.machines.compaction_press.stroke_load import StrokeLoad
from mech_twin.parts.four_bar import FourBar, Link, acute_angles, position

Array = NDArray[np.float64]
POSITIONS = 72
OBJECTIVES = ("peak_torque_nm", "flywheel_inertia_kg_m2", "mean_press_force_n")
SENSES = (1.0, 1.0, -1.0)  # to be made small, small, large
CONSTRAINTS = (
    "gamma_max_deg",
    "stroke_m",
    "transmission_angle_deg",
    "gamma_at_bottom_deg",
    "alpha_at_bottom_deg",
    "crank_plus_ground_m",
    "ground_minus_crank_m",
    "crank_shortest_m",
)


class Limits(NamedTuple):
    """Constraints (degrees, m) and what the press does (rpm, N, N m); the reference problem's values."""

    gamma_max_deg: float = 20.0
    stroke_m: float = 0.05
    transmission_deg: float = 50.0
    gamma_bottom_deg: float = 1.0
    alpha_bottom_deg: float = 85.0
    spare_m: float = 0.005
    speed_rad_per_s: float = 10.0 * math.pi
    non_uniformity: float = 0.05
    peak_n: float = 10000.0
    contact_fraction: float = 0.5
    exponent: float = 1.0
    constant_torque_nm: float = 250.0


REFERENCE_LIMITS = Limits()


@dataclass(frozen=True)
class Space:
    """Bounds of (r, l, h, R) in m, and the limits."""

    lower_m: tuple[float, float, float, float] = (0.02, 0.3, 0.1, 0.1)
    upper_m: tuple[float, float, float, float] = (0.12, 0.8, 0.5, 0.6)
    limits: Limits = REFERENCE_LIMITS

    def __post_init__(self) -> None:
        for name, low, high in zip(("r", "l", "h", "R"), self.lower_m, self.upper_m, strict=True):
            if not 0.0 < low <= high:
                raise ValueError(f"bounds of {name}: 0 < {low} <= {high} fails")


class Evaluation(NamedTuple):
    """Objectives, shape (n, 3), and margins of the constraints (negative: violated), shape (n, 8).

    A design that cannot be assembled at every position has infinite objectives, and margins of minus infinity but
    for the three of lengths.
    """

    objectives: Array
    margins: Array

    @property
    def feasible(self) -> NDArray[np.bool_]:
        """Which designs meet every constraint."""
        return np.asarray((self.margins >= 0.0).all(axis=1))


@kernel
def design_press(r: float, l: float, h: float, R: float) -> Press:
    """Return the press of a design (m): 80 kg/m plate, 16 kg/m pendulum, 5 kg crank, J1O = 0.002 + 5 r^2."""
    plate, pendulum = 80.0 * l, 16.0 * R
    return Press(
        FourBar(r, l, R, l, h, 1.0),
        Link(5.0, 0.002 + 5.0 * r * r, 0.0, 0.0),
        Link(plate, plate * l * l / 12.0, 0.5 * l, 0.0),
        Link(pendulum, pendulum * R * R / 12.0, 0.5 * R, 0.0),
        0.5 * l,
        0.0,
        StrokeLoad(0.0, 1.0, 0.0, 1.0),
        9.80665,
    )


@kernel
def _rotation_margins(r: float, l: float, h: float, R: float, spare: float, margins: Array) -> None:
    ground = math.hypot(l, h)
    margins[5] = l + R - r - ground - spare
    margins[6] = abs(ground - r) - abs(l - R) - spare
    margins[7] = min(l, R, ground) - r - spare


@kernel
def _bottom_angle(before: float, at: float, after: float) -> float:
    """Return how far the lowest point of a parabola through three samples lies from the middle one (steps)."""
    curve = before - 2.0 * at + after
    return 0.5 * (before - after) / curve if curve > 0.0 else 0.0


@kernel
def _angles_and_stroke(press: Press, limits: Limits, table: Array, margins: Array) -> tuple[int, int]:
    """Fill the unloaded columns and the first five margins; return the samples of top and bottom."""
    n = POSITIONS
    gamma_max, beta_min, top, bottom = 0.0, 10.0, 0, 0
    for k in range(n):
        f = 2.0 * math.pi * k / n
        at = position(press.bar, f)
        _, beta, gamma = acute_angles(at)
        gamma_max, beta_min = max(gamma_max, gamma), min(beta_min, beta)
        now = press_reduced(press, f, FREE)
        table[0, k], table[1, k], table[2, k] = now.inertia, now.slope, now.moment
        table[3, k], table[4, k] = now.y, now.y1
        if now.y > table[3, top]:
            top = k
        if now.y < table[3, bottom]:
            bottom = k
    alpha, _, gamma = acute_angles(position(press.bar, 2.0 * math.pi * bottom / n))
    margins[0] = limits.gamma_max_deg - math.degrees(gamma_max)
    margins[1] = table[3, top] - table[3, bottom] - limits.stroke_m
    margins[2] = math.degrees(beta_min) - limits.transmission_deg
    margins[3] = limits.gamma_bottom_deg - math.degrees(gamma)
    margins[4] = math.degrees(alpha) - limits.alpha_bottom_deg
    return top, bottom


@kernel
def _loaded_objectives(limits: Limits, table: Array, top: int, bottom: int, found: Array) -> None:
    n = POSITIONS
    y_t, y_b = table[3, top], table[3, bottom]
    y_c = y_t - limits.contact_fraction * (y_t - y_b)
    down = (bottom - top) % n
    first = -1.0
    for i in range(down + 1):
        k = (top + i) % n
        y = table[3, k]
        if y < y_c:
            if first < 0.0:
                above = table[3, (top + i - 1) % n]
                first = i - 1 + (above - y_c) / (above - y)
            table[2, k] += limits.peak_n * ((y_c - y) / (y_c - y_b)) ** limits.exponent * table[4, k]
    mean = 0.0
    for k in range(n):
        mean += table[2, k] / n
    w, delta = limits.speed_rad_per_s, limits.non_uniformity
    fast, slow = 0.5 * (w * (1.0 + 0.5 * delta)) ** 2, 0.5 * (w * (1.0 - 0.5 * delta)) ** 2
    work, peak = 0.0, 0.0
    high, low = -1e300, 1e300
    for k in range(n):
        if k > 0:
            work += (0.5 * (table[2, k] + table[2, k - 1]) - mean) * 2.0 * math.pi / n
        high, low = max(high, work - fast * table[0, k]), min(low, work - slow * table[0, k])
        peak = max(peak, abs(0.5 * w * w * table[1, k] - table[2, k]))
    last = down + _bottom_angle(table[3, (bottom - 1) % n], y_b, table[3, (bottom + 1) % n])
    found[0], found[1] = peak, (high - low) / (delta * w * w)
    found[2] = limits.constant_torque_nm * (last - first) * 2.0 * math.pi / n / (y_c - y_b)


@parallel_kernel
def _evaluated(designs: Array, limits: Array) -> tuple[Array, Array]:
    objectives = np.full((designs.shape[0], 3), np.inf)
    margins = np.full((designs.shape[0], 8), -np.inf)
    for i in prange(designs.shape[0]):
        set_ = Limits(
            limits[0],
            limits[1],
            limits[2],
            limits[3],
            limits[4],
            limits[5],
            limits[6],
            limits[7],
            limits[8],
            limits[9],
            limits[10],
            limits[11],
        )
        r, l, h, R = designs[i, 0], designs[i, 1], designs[i, 2], designs[i, 3]
        _rotation_margins(r, l, h, R, set_.spare_m, margins[i])
        if min(margins[i, 5], margins[i, 6]) > -set_.spare_m:
            table = np.empty((5, POSITIONS))
            top, bottom = _angles_and_stroke(design_press(r, l, h, R), set_, table, margins[i])
            _loaded_objectives(set_, table, top, bottom, objectives[i])
    return objectives, margins


def evaluation(designs: Array, limits: Limits) -> Evaluation:
    """Return objectives and constraint margins of designs (r, l, h, R), m, shape (n, 4).

    Peak of |torque| at constant speed (N m); flywheel (kg m2) from W by trapezoid on the samples, exact formula;
    mean press force (N) over the contact travel at a constant drive torque, torque times crank angle over travel.
    First contact is interpolated between samples, the bottom's angle by a parabola through three; heights are the
    samples'.  How the contact travel is read off the samples is our choice, the one under which the best-known mean
    force is reproduced: with every angle and height exact that design's comes out 3e-5 smaller, with the bottom taken
    at its sample 1.4e-4 smaller.
    """
    objectives, margins = _evaluated(
        np.ascontiguousarray(designs, dtype=np.float64), np.array(limits, dtype=np.float64)
    )
    return Evaluation(objectives, margins)
