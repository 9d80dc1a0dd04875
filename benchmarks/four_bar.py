# SPDX-License-Identifier: Apache-2.0
"""Throughput of the four-bar beside its peers, in turn in one run on one core.

``python benchmarks/four_bar.py [--write]``: positions and derivatives beside pylinkage's compiled model of the same
linkage, forces beside a batched solution of the 9x9 systems of equilibrium by numpy, which gets its kinematics from our
batch, a time step beside MuJoCo's of a loop closed by a soft constraint.  Results are compared before they are timed.
"""

from __future__ import annotations

import math
import sys
from pathlib import Path

import mujoco
import numpy as np
import pylinkage
from comparison import Table, in_turn, measure, ratio
from pylinkage.simulation import Linkage

from mech_twin.parameters.load import machine

sys.path.insert(0, str(Path(__file__).parents[1] / "test"))
from four_bar_batch import batch_forces, batch_motions, batch_positions, design_row, driven_run, full_turn

COUNT = 100_000
SOLVED, STEPS, ROUNDS, CRANK_NM = 10_000, 1000, 11, 60.0
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


def checked(ours: np.ndarray, theirs: np.ndarray, tolerance: float) -> None:
    """End the benchmark if two answers to the same question differ."""
    worst = float(np.abs(ours - theirs).max())
    if not worst <= tolerance:
        raise SystemExit(f"four_bar: the answers differ by {worst:g}, {tolerance:g} allowed")


def compiled_peer() -> Linkage:
    """Return pylinkage's model, compiled, after a turn that agrees with ours; their first step is one increment on."""
    linkage = peer_linkage()
    linkage.compile()
    checked(batch_positions(DESIGNS, ANGLES)[0, 2:, 1:].T, linkage.step_fast(COUNT)[:-1, 3], 1e-6)
    return linkage


def solved_forces() -> np.ndarray:
    """Return the forces of a tenth of the angles by the batched solution, after one that agrees with ours."""
    systems, right = newton_euler_systems(SOLVED)
    return np.linalg.solve(systems, right[:, :, None])[:, :, 0]


def mujoco_loop() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the linkage as MuJoCo bodies, assembled."""
    _, _, b_x, b_y = batch_positions(DESIGNS, np.zeros(1))[0, :, 0]
    plate = math.degrees(math.atan2(b_y, b_x - BAR.crank_m))
    pendulum = math.degrees(math.atan2(b_y - BAR.pivot_y_m, b_x - BAR.pivot_x_m))
    model = mujoco.MjModel.from_xml_string(LOOP.format(plate=plate, pendulum=pendulum))
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    checked(state.site("plate_b").xpos, state.site("pendulum_b").xpos, 1e-9)
    state.qfrc_applied[0] = CRANK_NM
    return model, state


def measured() -> list[Table]:
    """Return the table of all four comparisons."""
    linkage, (model, state) = compiled_peer(), mujoco_loop()
    every = COUNT // SOLVED
    checked(batch_forces(PRESS, DESIGNS, ANGLES[::every], SPEED, 0.0, LOADS[::every])[0].T, solved_forces(), 1e-7)
    pairs = (
        ("positions", "pylinkage", COUNT, COUNT,
         lambda: batch_positions(DESIGNS, ANGLES), lambda: linkage.step_fast(COUNT)),
        ("positions, speeds, accelerations", "pylinkage", COUNT, COUNT,
         lambda: batch_motions(DESIGNS, ANGLES, SPEED, 0.0), lambda: linkage.step_fast_with_kinematics(COUNT)),
        ("full force analysis", "numpy.linalg.solve", COUNT, SOLVED,
         lambda: batch_forces(PRESS, DESIGNS, ANGLES, SPEED, 0.0, LOADS), solved_forces),
        ("time step of 1 ms of the closed loop", "MuJoCo", STEPS, STEPS,
         lambda: driven_run(PRESS, 0.0, 0.0, 0.0, CRANK_NM, 0.001, STEPS),
         lambda: mujoco.mj_step(model, state, nstep=STEPS)),
    )  # fmt: skip
    rows = []
    for what, peer, our_count, their_count, ours, theirs in pairs:
        times = in_turn({"ours": ours, "theirs": theirs}, ROUNDS)
        rates = [f"{n / min(times[who]) / 1e6:.3g}" for who, n in (("ours", our_count), ("theirs", their_count))]
        each = {"ours": [t / our_count for t in times["ours"]], "theirs": [t / their_count for t in times["theirs"]]}
        rows.append((what, rates[0], peer, rates[1], ratio(each, "theirs", "ours")))
    how = f"One core, processor time, {ROUNDS} rounds in turn; million evaluations a second of the best round."
    return [Table(how, ("what", "ours", "peer", "the peer's", "ratio (spread)"), rows)]


if __name__ == "__main__":
    measure("four_bar", measured)
