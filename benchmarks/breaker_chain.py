# SPDX-License-Identifier: Apache-2.0
"""The whole breaker - motor, gear, four-bar with all inertias, blow, body - beside MuJoCo and Exudyn with the same one.

``python benchmarks/breaker_chain.py [--write]``.  All run from standstill; blow energy and rate are means of the
second half, judged by the motion solved as one (`machines.mb10_breaker.breaker_reference`: scipy's DOP853 at 1e-12,
no code shared with either).  A setting of a peer counts where its loop stays closed to 1e-5 m.  The peers are timed
without Python between their steps, at the motor torque at the run's end: that is their step alone.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import breaker_exudyn
import breaker_mjcf
import mujoco
import numpy as np
from breaker_mjcf import Peer, Told
from comparison import Table, Task, in_turn, measure, ratio
from fast_exudyn import exudyn

from mech_twin.engine.rollout import roll_out
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parameters.load import machine
from mech_twin.parts.induction_motor import motor_constants

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "test"))
from machines.mb10_breaker.breaker_reference import BreakerReference

DURATION_S, TIMED_S, ROUNDS = 3.0, 0.3, 5
LOOP_LIMIT_M = 1e-5
CLOSURE = "linkage.residual.loop_closure_m"
PEERS = (
    Peer("implicitfast", 2e-4, 4.0),
    Peer("implicitfast", 1e-4, 4.0),
    Peer("implicitfast", 5e-5, 4.0),
    Peer("implicitfast", 2e-5, 4.0),
    Peer("RK4", 2e-4, 4.0),
)
SETTINGS = (
    breaker_exudyn.Setting(2e-4, 4.0),
    breaker_exudyn.Setting(1e-4, 4.0),
    breaker_exudyn.Setting(5e-5, 4.0),
    breaker_exudyn.Setting(2e-5, 4.0),
    breaker_exudyn.Setting(2e-5, 8.0),
)
STEPS_S = (1e-3, 2e-3)


def late_mean(blows: np.ndarray) -> tuple[float, float]:
    """Return energy (J) and rate (1/s) of the blows in the second half, from their times (s) and energies (J)."""
    late = blows[blows[:, 0] > 0.5 * DURATION_S]
    return float(late[:, 1].mean()), float((len(late) - 1) / (late[-1, 0] - late[0, 0]))


def off(found: tuple[float, float], exact: tuple[float, float]) -> list[str]:
    """Return the errors of energy and rate in percent, as cells."""
    return [f"{100.0 * (a / b - 1.0):+.2g} %" for a, b in zip(found, exact, strict=True)]


def own_row(step_s: float, exact: tuple[float, float], tool_kg: float) -> tuple[object, ...]:
    """Return the row of the roll-out at a coupling step."""
    own = machine("mb10_breaker", overrides={"coupling.step_s": step_s})
    run = roll_out(own, DURATION_S, [CLOSURE])
    told = [(e.time_s, e.impulse_ns**2 / (2.0 * tool_kg)) for e in run.events if e.kind == "blow"]
    taken = in_turn({"own": lambda: roll_out(own, TIMED_S, ["time_s"])}, ROUNDS)["own"]
    loop = float(np.abs(run[CLOSURE]).max())
    errors = off(late_mean(np.array(told)), exact)
    return f"roll-out, {1e3 * step_s:g} ms", f"{loop:.0e}", f"{TIMED_S / min(taken):.3g}", *errors, ""


def mujoco_row(peer: Peer, p: BreakerParameters, exact: tuple[float, float]) -> tuple[object, ...]:
    """Return the row of MuJoCo in a setting."""
    b = breaker(p)
    model = breaker_mjcf.breaker_model(b, np.radians(p.linkage.initial_crank_deg), peer)
    told, state = breaker_mjcf.followed(b, motor_constants(p.motor), model, DURATION_S)
    steps = round(TIMED_S / peer.step_s)
    name = f"MuJoCo {peer.integrator}, {1e3 * peer.step_s:g} ms"
    return peer_row(name, told, exact, lambda: mujoco.mj_step(model, state, nstep=steps))


def exudyn_row(setting: breaker_exudyn.Setting, p: BreakerParameters, exact: tuple[float, float]) -> tuple[object, ...]:
    """Return the row of Exudyn in a setting."""
    b = breaker(p)
    model = breaker_exudyn.breaker_model(b, np.radians(p.linkage.initial_crank_deg), setting)
    told = breaker_exudyn.followed(b, motor_constants(p.motor), model, setting, DURATION_S)
    name = f"Exudyn {exudyn.__version__}, {1e3 * setting.step_s:g} ms, a blow {setting.contact_steps:g} steps"
    return peer_row(name, told, exact, lambda: breaker_exudyn.run_from_start(model, setting, TIMED_S))


def peer_row(name: str, told: Told, exact: tuple[float, float], timed: Task) -> tuple[object, ...]:
    """Return the row of a peer, with its time over that of the roll-out at the configured step."""
    own = machine("mb10_breaker")
    times = in_turn({"own": lambda: roll_out(own, TIMED_S, ["time_s"]), "peer": timed}, ROUNDS)
    loop = f"{told.loop_m:.0e}" + ("" if told.loop_m < LOOP_LIMIT_M else " (too open)")
    rate, errors = f"{TIMED_S / min(times['peer']):.3g}", off(late_mean(told.blows), exact)
    return name, loop, rate, *errors, ratio(times, "peer", "own")


def measured() -> list[Table]:
    """Return the table."""
    p = machine("mb10_breaker").parameters
    if not isinstance(p, BreakerParameters):
        raise TypeError("expected the breaker's parameters")
    tool_kg, begun = p.tool.mass_kg, time.process_time()
    struck = BreakerReference(p).run(np.array([0.0, DURATION_S])).blows
    spent = time.process_time() - begun
    exact = late_mean(np.column_stack((struck[:, 0], struck[:, 1] ** 2 / (2.0 * tool_kg))))
    rows = [own_row(step_s, exact, tool_kg) for step_s in STEPS_S]
    rows += [mujoco_row(peer, p, exact) for peer in PEERS] + [exudyn_row(each, p, exact) for each in SETTINGS]
    rows.append(("motion solved as one (the judge)", "exact", f"{DURATION_S / spent:.3g}", "0 %", "0 %", ""))
    how = (
        f"One core, processor time, {ROUNDS} rounds in turn; {DURATION_S:g} s from standstill, {exact[0]:.3f} J at "
        f"{exact[1]:.4f} blows a second by the judge. Last column: time of the peer over that of the roll-out at 1 ms."
    )
    columns = ("run", "loop error, m", "simulated s a second", "blow energy off", "blow rate off", "ratio (spread)")
    return [Table(how, columns, rows)]


if __name__ == "__main__":
    measure("breaker_chain", measured)
