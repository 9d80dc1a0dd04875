# SPDX-License-Identifier: Apache-2.0
"""Many positions of many four-bars at once, to compare with peers: positions, rates, accelerations, pin forces.

One compiled loop over designs and crank angles on all cores; the same scalar kernels as a live step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from mech_twin.engine.crank_state import mechanism_reduced
from mech_twin.engine.integration import DORMAND_PRINCE_8, Workspace, method_of, rates_of, start_step, take_step
from mech_twin.kernels.kernel import kernel, parallel_kernel
from mech_twin.machines.compaction_press.dynamics import FREE, Press
from mech_twin.parts.four_bar import FourBar, Link, coefficients, motion, pin_forces, position

Array = NDArray[np.float64]
A_X, A_Y, B_X, B_Y, W2, W3, E2, E3 = range(8)  # rows of positions and motions
O_X, O_Y, PIN_A_X, PIN_A_Y, PIN_B_X, PIN_B_Y, C_X, C_Y, MOMENT = range(9)  # rows of forces
CRANK, PLATE, PENDULUM = range(3)  # rows of the links


@kernel
def four_bar_of(row: Array) -> FourBar:
    """Return the four-bar of one row of ``designs``."""
    return FourBar(row[0], row[1], row[2], row[3], row[4], row[5])


@kernel
def link_of(row: Array) -> Link:
    """Return the link of one row of masses, inertias and centroids."""
    return Link(row[0], row[1], row[2], row[3])


@parallel_kernel
def batch_positions(designs: Array, angles: Array) -> Array:
    """Return A and B (m), rows (a_x, a_y, b_x, b_y), shape (designs, 4, angles).

    Parameters
    ----------
    designs : ndarray
        Rows of (crank, coupler, rocker, pivot x, pivot y, branch), m and +-1, shape (n, 6).
    angles : ndarray
        Crank angles (rad), shape (k,).
    """
    many, count = designs.shape[0], angles.size
    out = np.empty((many, B_Y + 1, count))
    block = 512
    pieces = (count + block - 1) // block
    for job in prange(many * pieces):
        i, start = job // pieces, (job % pieces) * block
        bar = four_bar_of(designs[i])
        for k in range(start, min(count, start + block)):
            at = position(bar, angles[k])
            out[i, A_X, k], out[i, A_Y, k], out[i, B_X, k], out[i, B_Y, k] = at.a_x, at.a_y, at.b_x, at.b_y
    return out


@parallel_kernel
def batch_motions(designs: Array, angles: Array, w: float, e: float) -> Array:
    """Return positions, rates and accelerations, shape (designs, 8, angles).

    Rows (a_x, a_y, b_x, b_y in m, w2, w3 in rad/s, e2, e3 in rad/s^2) at crank rate ``w`` and acceleration ``e``.
    """
    many, count = designs.shape[0], angles.size
    out = np.empty((many, E3 + 1, count))
    block = 512
    pieces = (count + block - 1) // block
    square = w * w
    for job in prange(many * pieces):
        i, start = job // pieces, (job % pieces) * block
        bar = four_bar_of(designs[i])
        for k in range(start, min(count, start + block)):
            at = position(bar, angles[k])
            by = coefficients(at)
            out[i, A_X, k], out[i, A_Y, k], out[i, B_X, k], out[i, B_Y, k] = at.a_x, at.a_y, at.b_x, at.b_y
            out[i, W2, k], out[i, W3, k] = by.g2 * w, by.g3 * w
            out[i, E2, k], out[i, E3, k] = by.g2 * e + by.g2_1 * square, by.g3 * e + by.g3_1 * square
    return out


@parallel_kernel
def _forces(
    links: Array,
    along: float,
    across: float,
    gravity: float,
    designs: Array,
    angles: Array,
    w: float,
    e: float,
    force: Array,
) -> Array:
    many, count = designs.shape[0], angles.size
    out = np.empty((many, MOMENT + 1, count))
    block = 512
    pieces = (count + block - 1) // block
    for job in prange(many * pieces):
        i, start = job // pieces, (job % pieces) * block
        bar = four_bar_of(designs[i])
        crank, plate, pendulum = link_of(links[CRANK]), link_of(links[PLATE]), link_of(links[PENDULUM])
        for k in range(start, min(count, start + block)):
            at = position(bar, angles[k])
            by = motion(bar, crank, plate, pendulum, at, coefficients(at), w, e)
            x = at.a_x + (along * at.u_x - across * at.u_y) / bar.coupler_m
            y = at.a_y + (along * at.u_y + across * at.u_x) / bar.coupler_m
            pins = pin_forces(bar, crank, plate, pendulum, at, by, e, 0.0, -gravity, 0.0, force[k], x, y)
            out[i, O_X, k], out[i, O_Y, k], out[i, PIN_A_X, k], out[i, PIN_A_Y, k] = (
                pins.o_x,
                pins.o_y,
                pins.a_x,
                pins.a_y,
            )
            out[i, PIN_B_X, k], out[i, PIN_B_Y, k], out[i, C_X, k], out[i, C_Y, k] = (
                pins.b_x,
                pins.b_y,
                pins.c_x,
                pins.c_y,
            )
            out[i, MOMENT, k] = pins.moment
    return out


def batch_forces(press: Press, designs: Array, angles: Array, w: float, e: float, force: Array) -> Array:
    """Return every pin force and the drive moment, shape (designs, 9, angles).

    Rows (R_O, R_A, R_B, R_C as x, y in N; M in N m), under an upward force on the plate (N) given at each angle.
    Masses and the point of the force are those of ``press``; lengths and branch come from ``designs``.
    """
    links = np.array([press.crank, press.plate, press.pendulum], dtype=np.float64)
    return _forces(links, press.along_m, press.across_m, press.gravity, designs, angles, w, e, force)


def design_row(bar: FourBar) -> Array:
    """Return one row of ``designs``."""
    return np.array([tuple(bar)], dtype=np.float64)


def full_turn(count: int) -> Array:
    """Return ``count`` crank angles spread over one turn (rad)."""
    return np.asarray(np.arange(count) * (2.0 * math.pi / count), dtype=np.float64)


class DrivenPress(NamedTuple):
    """A press without layer, and the inertia (kg m2) and constant torque (N m) of the shaft at its crank."""

    press: Press
    shaft_kg_m2: float
    torque_nm: float


@rates_of(DrivenPress, DORMAND_PRINCE_8)
def driven_rates(system: DrivenPress, t: float, y: Array, out: Array) -> None:
    """Fill in the rates of crank angle and speed."""
    inertia, slope, moment = mechanism_reduced(system.press, y[0], FREE)
    out[0] = y[1]
    out[1] = (moment + system.torque_nm - 0.5 * y[1] * y[1] * slope) / (inertia + system.shaft_kg_m2)


@kernel
def driven_run(
    press: Press, shaft: float, f: float, w: float, torque: float, h: float, steps: int
) -> tuple[float, float]:
    """Return crank angle (rad) and rate (rad/s) after many steps of ``h`` seconds under a constant torque, no layer."""
    system = DrivenPress(press, shaft, torque)
    rows, y = len(method_of(system).nodes), np.array([f, w])
    work = Workspace(np.empty((rows, y.size)), np.empty(y.size), np.empty(y.size))
    for _ in range(steps):
        start_step(system, 0.0, y, work)
        take_step(system, 0.0, y, h, work)
        y[:] = work.end
    return y[0], y[1]
