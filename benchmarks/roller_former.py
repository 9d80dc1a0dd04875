# SPDX-License-Identifier: Apache-2.0
"""The roller former's integrator against real time, against scipy's DOP853, and against MuJoCo with the same carts.

Motor on, table set, k = 8000 N m s/rad.  ``scipy``: the same equations, the same method and tolerance, right-hand side
from our compiled kernels, so the ratio is what one compiled kernel saves.  ``MuJoCo``: the carts as bodies (crank, rods
of negligible mass with half of it at either end, sliding carts closed by a connect of sites), the drive as a hinge on a
hinge with spring and damper, Kloss torque applied each step; no load, since MuJoCo has no friction that the page's (12)
would be.  Accuracy: the range of the twist over one steady turn against ours at a tolerance of 1e-12.

``python benchmarks/roller_former.py [--write]``.
"""

from __future__ import annotations

import sys
from pathlib import Path

import mujoco
import numpy as np
from comparison import Table, in_turn, measure, ratio
from scipy.integrate import solve_ivp

from mech_twin.machines.roller_former.cart_statics import load_moment, shaft_terms
from mech_twin.machines.roller_former.dynamics import LOADED, Former, state_array
from mech_twin.machines.roller_former.parameters import former_of
from mech_twin.machines.roller_former.steady import closed_extremes, steady_turn, turned
from mech_twin.parts.induction_motor import motor_torque

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
from roller_former_cases import parameters_for

SIMULATED_S, PEER_S, ROUNDS = 5.0, 2.0, 5
SYNCHRONOUS = 1000.0 * np.pi / 30.0 / 9.8
LOADS = ("none", "reversing")
SETTINGS = ((1e-3, "implicitfast"), (2.5e-4, "implicitfast"), (2.5e-4, "RK4"))


def tighter(former: Former, tolerance: float) -> Former:
    """Return the same former with another error allowed per step, over the scale of each coordinate."""
    return former._replace(tolerances=tolerance * np.array(former.scales))


def ours(former: Former, duration_s: float) -> np.ndarray:
    """Return the state after a run from synchronous speed under full load."""
    y, modes = state_array(0.0, SYNCHRONOUS), np.array(LOADED)
    turned(former, 1.0, 0.0, duration_s, 1, np.inf, y, modes)
    return y


def peer(former: Former, duration_s: float) -> np.ndarray:
    """Return the same from ``solve_ivp``."""
    sides = np.ones(former.bank.offset_rad.size)

    def slope(_: float, y: np.ndarray) -> tuple[float, float, float, float]:
        crank, twist, speed, rate = y
        inertia, half, _moment = shaft_terms(former.bank, crank, sides, 1.0)
        shaft = motor_torque(former.motor, (speed + rate) * former.ratio, 1.0)
        moment = shaft * former.ratio * (former.efficiency if shaft > 0.0 else 1.0 / former.efficiency)
        passed = former.stiffness_nm_per_rad * twist + former.damping_nms_per_rad * rate
        ahead = (passed - load_moment(former.bank, crank, 1.0) - half * speed * speed) / inertia
        return speed, rate, ahead, (moment - passed) / former.motor_inertia_kg_m2 - ahead

    begin = [0.0, 0.0, SYNCHRONOUS, 0.0]
    run = solve_ivp(slope, (0.0, duration_s), begin, "DOP853", rtol=1e-9, atol=1e-11)
    return np.asarray(run.y[:, -1])


def mujoco_model(former: Former, timestep_s: float, integrator: str) -> mujoco.MjModel:
    """Return the carts as MuJoCo bodies; x along the rails, hinges about z."""
    bank, joined, bodies = former.bank, [], []
    r, length = bank.crank_m, bank.rod_m
    cranks = ""
    for i in range(bank.offset_rad.size):
        psi = bank.offset_rad[i]
        ax, ay = r * np.cos(psi), r * np.sin(psi)
        reach = ax + np.sqrt(length**2 - ay**2)
        lean = np.arctan2(-ay, reach - ax)
        tiny = "mass='1e-6' diaginertia='1e-8 1e-8 1e-8'"
        cranks += (
            f"<body pos='{ax} {ay} 0'><inertial pos='0 0 0' mass='{bank.rod_half_kg[i]}' diaginertia='1e-8 1e-8 1e-8'/>"
            f"<body euler='0 0 {lean}'><joint type='hinge' axis='0 0 1'/><inertial pos='0 0 0' {tiny}/>"
            f"<site name='rod{i}' pos='{length} 0 0'/></body></body>"
        )
        bodies.append(
            f"<body pos='{reach} 0 0'><joint type='slide' axis='1 0 0'/>"
            f"<inertial pos='0 0 0' mass='{bank.mass_kg[i]}' diaginertia='1 1 1'/><site name='cart{i}'/></body>"
        )
        joined.append(
            f"<connect site1='rod{i}' site2='cart{i}' solref='{2.0 * timestep_s} 1' solimp='.9999 .9999 .001'/>"
        )
    xml = f"""<mujoco><compiler angle='radian'/>
      <option timestep='{timestep_s}' gravity='0 0 0' integrator='{integrator}' iterations='100' tolerance='1e-14'/>
      <worldbody><body><joint name='drive' type='hinge' axis='0 0 1' armature='{former.motor_inertia_kg_m2}'/>
        <inertial pos='0 0 0' mass='1e-6' diaginertia='1e-8 1e-8 1e-8'/>
        <body><joint name='twist' type='hinge' axis='0 0 1' stiffness='{former.stiffness_nm_per_rad}'
          damping='{former.damping_nms_per_rad}'/><inertial pos='0 0 0' mass='1e-6' diaginertia='1e-8 1e-8 1e-8'/>
          {cranks}</body></body>{"".join(bodies)}</worldbody><equality>{"".join(joined)}</equality></mujoco>"""
    return mujoco.MjModel.from_xml_string(xml)


def mujoco_run(former: Former, timestep_s: float, integrator: str) -> float:
    """Return the twist's range over the last turn (rad)."""
    model = mujoco_model(former, timestep_s, integrator)
    state = mujoco.MjData(model)
    mujoco.mj_forward(model, state)
    start_speeds(former, model, state)
    twists, gain = [], former.ratio * former.efficiency
    for _ in range(round(PEER_S / timestep_s)):
        state.qfrc_applied[0] = motor_torque(former.motor, state.qvel[0] * former.ratio, 1.0) * gain
        mujoco.mj_step(model, state)
        twists.append(state.qpos[1])
    turn = np.array(twists[-round(2.0 * np.pi / SYNCHRONOUS / timestep_s) :])
    return float(np.ptp(turn))


def start_speeds(former: Former, model: mujoco.MjModel, state: mujoco.MjData) -> None:
    """Give every joint the rate that goes with a shaft at synchronous speed."""
    bank = former.bank
    state.qvel[0] = SYNCHRONOUS
    for i in range(bank.offset_rad.size):
        psi = bank.offset_rad[i]
        rod_sine = bank.ratio * np.sin(psi)
        rod_cosine = np.sqrt(1.0 - rod_sine**2)
        rod_rate = -bank.ratio * np.cos(psi) / rod_cosine * SYNCHRONOUS
        state.qvel[2 + i] = rod_rate - SYNCHRONOUS
        travel = -bank.crank_m * (np.sin(psi) + bank.ratio * np.sin(psi) * np.cos(psi) / rod_cosine)
        state.qvel[2 + bank.offset_rad.size + i] = travel * SYNCHRONOUS


def times_real_time() -> Table:
    """Return the speed of the integrator with one to four carts."""
    rows = []
    for carts in range(1, 5):
        formers = [former_of(parameters_for(carts, {"load": load})) for load in LOADS]
        tasks = {load: lambda f=f: ours(f, SIMULATED_S) for load, f in zip(LOADS, formers, strict=True)}
        times = in_turn(tasks, ROUNDS)
        rows.append((carts, *(f"{SIMULATED_S / min(times[load]):.0f}" for load in LOADS)))
    how = f"Integrator alone, times real time, one core, processor time, best of {ROUNDS} rounds."
    return Table(how, ("carts", "no load", "reversing load"), rows)


def beside_scipy() -> Table:
    """Return the comparison with DOP853 in Python on the same compiled right-hand side."""
    rows = []
    for load in LOADS:
        former = former_of(parameters_for(4, {"load": load}))
        times = in_turn({"ours": lambda f=former: ours(f, PEER_S), "theirs": lambda f=former: peer(f, PEER_S)}, 3)
        exact = ours(tighter(former, 1e-13), PEER_S)[:4]
        off = [abs(f(former, PEER_S)[:4] - exact)[1] / abs(exact[1]) for f in (ours, peer)]
        if not off[0] < 1e-7:
            raise SystemExit(f"roller_former: the twist is off by {off[0]:g}, 1e-7 allowed")
        rows.append((load, ratio(times, "theirs", "ours"), f"{off[0]:.1e}", f"{off[1]:.1e}"))
    how = "scipy's DOP853, the same equations and tolerance, four carts: its time over ours; errors of the twist."
    return Table(how, ("load", "ratio (spread)", "our error", "its error"), rows)


def beside_mujoco() -> Table:
    """Return the comparison with MuJoCo, three carts."""
    former = former_of(parameters_for(3, {"load": "none"}))
    turn = steady_turn(tighter(former, 1e-12))
    if turn is None:
        raise SystemExit("roller_former: no steady turn")
    exact, rows = float(np.ptp(closed_extremes(turn.columns.twist_rad))), []
    for timestep_s, integrator in SETTINGS:
        found = mujoco_run(former, timestep_s, integrator)
        if abs(found / exact - 1.0) > 0.2:
            raise SystemExit(f"roller_former: not the same machine: twist range {found:g}, {exact:g} expected")
        tasks = {
            "ours": lambda: ours(former, PEER_S),
            "theirs": lambda h=timestep_s, i=integrator: mujoco_run(former, h, i),
        }
        times = in_turn(tasks, 3)
        rows.append(
            (f"{integrator}, {1e3 * timestep_s:g} ms", ratio(times, "theirs", "ours"), f"{found / exact - 1:+.1e}")
        )
    how = "MuJoCo with three carts, motor torque set each step: its time over ours; error of the twist's range."
    return Table(how, ("MuJoCo", "ratio (spread)", "its error"), rows)


def measured() -> list[Table]:
    """Return all tables."""
    return [times_real_time(), beside_scipy(), beside_mujoco()]


if __name__ == "__main__":
    measure("roller_former", measured)
