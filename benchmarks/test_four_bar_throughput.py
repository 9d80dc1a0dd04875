# SPDX-License-Identifier: Apache-2.0
"""Throughput of the four-bar beside its peers, in one run on one machine: read the ratios, not the seconds.

Run with ``pytest benchmarks/test_four_bar_throughput.py``; each benchmark says in ``extra_info`` how many million
evaluations a second it reached.  Results are compared, times never asserted.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
import pylinkage
import pytest
from pylinkage.simulation import Linkage

from mech_twin.machines.compaction_press.batch import (
    batch_forces,
    batch_motions,
    batch_positions,
    design_row,
    driven_run,
    full_turn,
)
from mech_twin.parameters.load import machine

COUNT = 100_000
SPEED = 10.0 * math.pi
PRESS = machine("compaction_press").linkage.mechanism
BAR = PRESS.bar
DESIGNS = design_row(BAR)
ANGLES = full_turn(COUNT)
LOADS = np.where((ANGLES > 3.25) & (ANGLES < 4.71), 8000.0, 0.0)

LOOP = """
<mujoco>
  <option gravity="0 -9.80665 0" timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <body name="crank">
      <joint type="hinge" axis="0 0 1"/>
      <inertial pos="0 0 0" mass="5" diaginertia="0.02 0.02 0.02"/>
      <body name="plate" pos="0.06 0 0" euler="0 0 {plate}">
        <joint type="hinge" axis="0 0 1"/>
        <inertial pos="0.25 0 0" mass="40" diaginertia="0.8333 0.8333 0.8333"/>
        <site name="plate_b" pos="0.5 0 0"/>
      </body>
    </body>
    <body name="pendulum" pos="0.5 0.24 0" euler="0 0 {pendulum}">
      <joint type="hinge" axis="0 0 1"/>
      <inertial pos="0.15 0 0" mass="5" diaginertia="0.0375 0.0375 0.0375"/>
      <site name="pendulum_b" pos="0.3 0 0"/>
    </body>
  </worldbody>
  <equality><connect site1="plate_b" site2="pendulum_b"/></equality>
</mujoco>
"""


def rate(benchmark, count):
    """Note how many million evaluations a second the best round reached."""
    if benchmark.stats is not None:
        benchmark.extra_info["million_per_s"] = round(count / benchmark.stats.stats.min / 1e6, 3)


def peer_linkage():
    """Return pylinkage's model of the same four-bar, turning through one turn in COUNT steps."""
    b_x, b_y = batch_positions(DESIGNS, ANGLES[:1])[0, 2:, 0]
    ground, pivot = pylinkage.Ground(0.0, 0.0), pylinkage.Ground(BAR.pivot_x_m, BAR.pivot_y_m)
    crank = pylinkage.Crank(ground, BAR.crank_m, angular_velocity=2.0 * math.pi / COUNT)
    dyad = pylinkage.RRRDyad(crank, pivot, BAR.coupler_m, BAR.rocker_m, x=b_x, y=b_y)
    linkage = Linkage([ground, pivot, crank, dyad])
    linkage.set_input_velocity(crank, SPEED)
    return linkage


def newton_euler_systems(count):
    """Return the 9x9 systems of equilibrium (unknowns R_O, R_A, R_B, R_C, M) and their right sides."""
    angles, loads = ANGLES[:: COUNT // count], LOADS[:: COUNT // count]
    a_x, a_y, b_x, b_y, w2, w3, e2, e3 = batch_motions(DESIGNS, angles, SPEED, 0.0)[0]
    u_x, u_y, v_x, v_y = b_x - a_x, b_y - a_y, b_x - BAR.pivot_x_m, b_y - BAR.pivot_y_m
    s2 = (
        -(SPEED**2) * a_x - 0.5 * (e2 * u_y + w2**2 * u_x),
        -(SPEED**2) * a_y + 0.5 * (e2 * u_x - w2**2 * u_y),
    )
    s3 = (-0.5 * (e3 * v_y + w3**2 * v_x), 0.5 * (e3 * v_x - w3**2 * v_y))
    m, right = np.zeros((angles.size, 9, 9)), np.zeros((angles.size, 9))
    g = 9.80665
    # crank: R_O - R_A = m (a - g); moment about O: M - A x R_A = 0
    m[:, 0, 0] = m[:, 1, 1] = 1.0
    m[:, 0, 2] = m[:, 1, 3] = -1.0
    right[:, 1] = PRESS.crank.mass_kg * g
    m[:, 2, 8], m[:, 2, 2], m[:, 2, 3] = 1.0, a_y, -a_x
    # plate: R_A + R_B + Q; moments about its centroid
    m[:, 3, 2] = m[:, 3, 4] = m[:, 4, 3] = m[:, 4, 5] = 1.0
    right[:, 3] = PRESS.plate.mass_kg * s2[0]
    right[:, 4] = PRESS.plate.mass_kg * (s2[1] + g) - loads
    m[:, 5, 2], m[:, 5, 3], m[:, 5, 4], m[:, 5, 5] = 0.5 * u_y, -0.5 * u_x, -0.5 * u_y, 0.5 * u_x
    right[:, 5] = PRESS.plate.inertia_kg_m2 * e2
    # pendulum: R_C - R_B; moments about its centroid
    m[:, 6, 6] = m[:, 7, 7] = 1.0
    m[:, 6, 4] = m[:, 7, 5] = -1.0
    right[:, 6] = PRESS.pendulum.mass_kg * s3[0]
    right[:, 7] = PRESS.pendulum.mass_kg * (s3[1] + g)
    m[:, 8, 6], m[:, 8, 7], m[:, 8, 4], m[:, 8, 5] = 0.5 * v_y, -0.5 * v_x, 0.5 * v_y, -0.5 * v_x
    right[:, 8] = PRESS.pendulum.inertia_kg_m2 * e3
    return m, right


@pytest.mark.benchmark(group="positions")
def test_positions(benchmark):
    result = benchmark(batch_positions, DESIGNS, ANGLES)
    assert np.isfinite(result).all()
    rate(benchmark, COUNT)


@pytest.mark.benchmark(group="positions")
def test_positions_pylinkage(benchmark):
    linkage = peer_linkage()
    linkage.compile()
    theirs = linkage.step_fast(COUNT)
    ours = batch_positions(DESIGNS, ANGLES)[0]
    # their first step is one increment on
    assert theirs[:-1, 3] == pytest.approx(ours[2:, 1:].T, abs=1e-6)
    benchmark(linkage.step_fast, COUNT)
    rate(benchmark, COUNT)


@pytest.mark.benchmark(group="positions with derivatives")
def test_motions(benchmark):
    benchmark(batch_motions, DESIGNS, ANGLES, SPEED, 0.0)
    rate(benchmark, COUNT)


@pytest.mark.benchmark(group="positions with derivatives")
def test_motions_pylinkage(benchmark):
    linkage = peer_linkage()
    linkage.compile()
    linkage.step_fast_with_kinematics(10)
    benchmark(linkage.step_fast_with_kinematics, COUNT)
    rate(benchmark, COUNT)


@pytest.mark.benchmark(group="full force analysis")
def test_forces(benchmark):
    benchmark(batch_forces, PRESS, DESIGNS, ANGLES, SPEED, 0.0, LOADS)
    rate(benchmark, COUNT)


@pytest.mark.benchmark(group="full force analysis")
def test_forces_by_batched_solve(benchmark):
    """The peer gets its kinematics from our compiled batch; its time is mostly assembly and solution of the systems."""
    count = 10_000

    def solved():
        systems, right = newton_euler_systems(count)
        return np.linalg.solve(systems, right[:, :, None])[:, :, 0]

    step = COUNT // count
    ours = batch_forces(PRESS, DESIGNS, ANGLES[::step], SPEED, 0.0, LOADS[::step])[0]
    assert solved() == pytest.approx(ours.T, abs=1e-7)
    benchmark(solved)
    rate(benchmark, count)


@pytest.mark.benchmark(group="time step of the closed loop")
def test_driven_step(benchmark):
    benchmark(driven_run, PRESS, 0.0, 0.0, 0.0, 60.0, 0.001, 1000)
    rate(benchmark, 1000)


@pytest.mark.benchmark(group="time step of the closed loop")
def test_step_mujoco(benchmark):
    _, _, b_x, b_y = batch_positions(DESIGNS, np.zeros(1))[0, :, 0]
    plate = math.degrees(math.atan2(b_y, b_x - BAR.crank_m))
    pendulum = math.degrees(math.atan2(b_y - BAR.pivot_y_m, b_x - BAR.pivot_x_m))
    model = mujoco.MjModel.from_xml_string(LOOP.format(plate=plate, pendulum=pendulum))
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    assert np.linalg.norm(state.site("plate_b").xpos - state.site("pendulum_b").xpos) < 1e-9

    def run():
        state.qfrc_applied[0] = 60.0
        mujoco.mj_step(model, state, nstep=1000)

    benchmark(run)
    rate(benchmark, 1000)
