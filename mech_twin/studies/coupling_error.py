"""How far the coupled run of the breaker lies from the motion solved as one, and the order in the coupling step.

The reference knows nothing of samples or steps: crank, body and motor in one set of equations, the torque evaluated at
every stage, fixed substeps of 0.1 ms and eighth order, each event bisected on its own.  It shares with the machine the
equations (masses, blow, touchdown) and not the scheme.

    python -m mech_twin.studies.coupling_error
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.run import frames
from mech_twin.engine.tableaus import COOPER_VERNER_8
from mech_twin.kernel import kernel
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.constants import breaker
from mech_twin.machines.mb10_breaker.dynamics import PHI, STATES, Breaker, P, Q, U, blow, derivatives, gap, touchdown
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.step import TURNS, ahead
from mech_twin.parameters.load import machine_parameters
from mech_twin.parts.induction_motor import MotorConstants, motor_constants, motor_torque

Array = NDArray[np.float64]
TABLEAU, WEIGHTS = COOPER_VERNER_8.stages, COOPER_VERNER_8.weights
STAGES = len(WEIGHTS)
SUBSTEP_S = 1e-4
PLASTIC_BELOW = 1e-9  # rad/s: a bounce slower than this ends the series


@kernel
def _step(b: Breaker, motor: MotorConstants, state: Array, rests: bool, span: float, room: Array, out: Array) -> None:
    """Fill the state a span later, the motor's torque taken at the rotor's speed of every stage."""
    for i in range(STAGES):
        room[STAGES] = state
        for j in range(i):
            room[STAGES] += span * TABLEAU[i, j] * room[j]
        rotor = b.ratio * (room[STAGES, U] - b.frame_drive * room[STAGES, P])
        derivatives(b, room[STAGES], motor_torque(motor, rotor, 1.0), rests, room[i])
    out[:] = state
    for i in range(STAGES):
        out += span * WEIGHTS[i] * room[i]


@kernel
def _sign(b: Breaker, motor: MotorConstants, which: int, state: Array, rests: bool, room: Array) -> float:
    """Return what must stay positive: the gap (0), the lift (1) or the collar's moment (2)."""
    if which == 0:
        return gap(b, state[Q], state[U], state[PHI], state[P])[0]
    if which == 1:
        return float(state[PHI])
    rotor = b.ratio * (state[U] - b.frame_drive * state[P])
    return derivatives(b, state, motor_torque(motor, rotor, 1.0), rests, room[0])


@kernel
def _bisected(
    b: Breaker, motor: MotorConstants, which: int, state: Array, rests: bool, span: float, room: Array, out: Array
) -> float:
    low, high = 0.0, span
    for _ in range(60):
        middle = 0.5 * (low + high)
        _step(b, motor, state, rests, middle, room, out)
        if _sign(b, motor, which, out, rests, room) > 0.0:
            low = middle
        else:
            high = middle
    _step(b, motor, state, rests, high, room, out)
    return high


@kernel
def reference_motion(b: Breaker, motor: MotorConstants, start: float, step_s: float, steps: int) -> tuple[Array, Array]:
    """Return samples (steps + 1, 4: q unwrapped, u, phi, p) and blows (n, 2: time, impulse) of the motion."""
    samples, blows = np.empty((steps + 1, 4)), np.zeros((steps, 2))
    room, end, out = np.empty((STAGES + 1, STATES)), np.empty(STATES), np.empty(STATES)
    state = np.zeros(STATES)
    state[Q] = start
    rests, armed, count = True, False, 0
    samples[0] = state[:4]
    for n in range(steps):
        time = 0.0
        while step_s - time > 1e-15:
            span = min(SUBSTEP_S, step_s - time)
            to_extreme = ahead(b, state[Q])
            armed = armed or 1.5 < to_extreme < 2.5
            _step(b, motor, state, rests, span, room, end)
            which, when = -1, span
            for event in range(3):
                watched = armed if event == 0 else (event == 1) != rests
                moving = event != 1 or state[P] != 0.0 or state[PHI] > 0.0
                if watched and moving and _sign(b, motor, event, end, rests, room) <= 0.0:
                    found = _bisected(b, motor, event, state, rests, span, room, out)
                    if found <= when:
                        which, when = event, found
            _step(b, motor, state, rests, when, room, out)
            state[:] = out
            time += when
            if which == 0:
                hit = blow(b, state[Q], state[U], state[PHI], state[P], rests)
                blows[count, 0], blows[count, 1] = n * step_s + time, hit.impulse
                state[U], state[P] = hit.u, hit.p
                rests, armed, count = rests and hit.p <= 0.0, False, count + 1
            elif which == 1:
                slow = -state[P] * b.restitution < PLASTIC_BELOW
                u, p, _, _ = touchdown(b, state[Q], state[U], 0.0, state[P], 0.0 if slow else b.restitution)
                state[U], state[PHI], state[P] = u, 0.0, p
                rests = slow
            elif which == 2:
                rests = False
        samples[n + 1] = state[:4]
    return samples, blows[:count]


class CouplingError(NamedTuple):
    """Worst differences between a coupled run and the reference."""

    step_s: float
    crank_angle_rad: float
    body_angle_rad: float
    blow_time_s: float
    blow_impulse_relative: float


def coupling_error(parameters: BreakerParameters, step_s: float, duration_s: float) -> CouplingError:
    """Return the worst differences from standstill to ``duration_s`` with a coupling step of ``step_s``."""
    coupling = parameters.coupling.model_copy(update={"step_s": step_s})
    p = parameters.model_copy(update={"coupling": coupling})
    run = list(frames(build(p), duration_s))
    start = run[0].linkage.position[0]
    samples, blows = reference_motion(breaker(p), motor_constants(p.motor), start, step_s, len(run) - 1)
    turned = np.array([f.linkage.position[0] + 2.0 * np.pi * f.linkage.memory.values[TURNS] for f in run])
    body = np.array([f.linkage.position[3] for f in run])
    met = np.array([(e.time_s, e.impulse_ns) for f in run for e in f.linkage.events if e.kind == "blow"])
    if met.shape != blows.shape:
        raise RuntimeError(f"the coupled run has {len(met)} blows, the reference {len(blows)}")
    return CouplingError(
        step_s,
        float(np.abs(turned - samples[:, Q]).max()),
        float(np.abs(body - samples[:, PHI]).max()),
        float(np.abs(met[:, 0] - blows[:, 0]).max()),
        float(np.abs(met[:, 1] / blows[:, 1] - 1.0).max()),
    )


def coupling_table(parameters: BreakerParameters, steps_s: tuple[float, ...], duration_s: float) -> list[CouplingError]:
    """Return the errors of each coupling step."""
    return [coupling_error(parameters, step_s, duration_s) for step_s in steps_s]


def main() -> None:
    """Print the table of the machine's page."""
    asked = argparse.ArgumentParser(description="coupling error of the breaker against the motion solved as one")
    asked.add_argument("--duration", type=float, default=5.0, help="simulated seconds from standstill")
    asked.add_argument("--steps", type=float, nargs="+", default=[2e-3, 1e-3, 5e-4, 2.5e-4], help="coupling steps, s")
    asked.add_argument("--order", type=int, default=1, choices=(0, 1), help="order of the torque's extrapolation")
    given = asked.parse_args()
    p = machine_parameters("mb10_breaker", overrides={"coupling.extrapolation_order": given.order})
    if not isinstance(p, BreakerParameters):
        raise TypeError("expected the breaker's parameters")
    print("step_s    crank_angle_rad  body_angle_rad  blow_time_s  blow_impulse")  # noqa: T201
    for row in coupling_table(p, tuple(given.steps), given.duration):
        print("{:<9g} {:<16.3g} {:<15.3g} {:<12.3g} {:.3g}".format(*row))  # noqa: T201


if __name__ == "__main__":
    main()
