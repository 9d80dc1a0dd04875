# SPDX-License-Identifier: Apache-2.0
"""Motion of the crank from a measured run: zero, angle, speed and acceleration, at its own instants."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_smoothing_spline

from mech_twin.errors import MeasurementError
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import FREE, PER_RUN
from mech_twin.measurements.model_turn import ModelTurn, following
from mech_twin.measurements.plausibility import pairs_with_crank
from mech_twin.measurements.runs import MeasuredChannel, MeasuredRun

WINDOW = 4000  # samples smoothed in one piece
OVERLAP = 200  # samples added on either side, whose result is discarded
CHOSEN, CHOICES = 400, 3  # samples in a piece that determines the penalty, and number of pieces
PENALTIES = np.geomspace(1e-6, 1e6, 13)
FOLLOWED = 0.9  # least correlation of a channel that determines the zero of the crank


@dataclass(frozen=True)
class CrankMotion:
    """Motion of the crank at the instants of its own channel, shape (n,) each: rad, rad/s, rad/s2.

    ``angle = measured - zero_rad``; ``zero_rad`` is 0 if the map gives the zero.
    """

    times_s: Array
    angle_rad: Array
    speed_rad_per_s: Array
    acceleration_rad_per_s2: Array
    zero_rad: float = 0.0


def crank_motion(run: MeasuredRun, turn: ModelTurn) -> CrankMotion:
    """Return the motion of the crank; an unknown zero is estimated from the best-correlated channel.

    Raises
    ------
    MeasurementError
        The crank is not measured, or its zero is unknown and no channel determines it.
    """
    crank = run.channel(turn.crank)
    if crank is None:
        names = ", ".join(channel.name for channel in run.channels)
        raise MeasurementError(run.path, f"{turn.crank} is not measured, only {names}: no motion without it")
    zero = _zero(run, turn, crank)
    angle, speed, acceleration = smoothed(crank.times_s, crank.values - zero)
    return CrankMotion(crank.times_s, angle, speed, acceleration, zero)


def _zero(run: MeasuredRun, turn: ModelTurn, crank: MeasuredChannel) -> float:
    if crank.channel.zero not in (FREE, PER_RUN):
        return 0.0
    pairs = pairs_with_crank(run, turn)
    found = [following(turn, p.channel.name, p.crank_rad, p.values, signs_known=True) for p in pairs]
    best = max(found, key=lambda each: each.correlation, default=None)
    if best is None or best.correlation < FOLLOWED:
        raise MeasurementError(
            run.path,
            f"the zero of {crank.name} is {crank.channel.zero} and no other channel determines it; expected a number",
        )
    return best.crank_zero_rad


def smoothed(times_s: Array, values: Array) -> tuple[Array, Array, Array]:
    """Return values, first and second derivative of a smoothing spline at ascending times, shape (n,) each.

    Its penalty is the median of those chosen by generalised cross-validation in a few pieces of the run: that choice
    takes most of the time, and the noise of a sensor is constant.
    """
    starts = np.linspace(0, max(0, len(times_s) - CHOSEN), CHOICES).astype(int)
    found = [_chosen(times_s[i : i + CHOSEN], values[i : i + CHOSEN]) for i in dict.fromkeys(starts.tolist())]
    penalty = float(np.median(found))
    parts = []
    for begin in range(0, len(times_s), WINDOW):
        first, last = max(0, begin - OVERLAP), min(len(times_s), begin + WINDOW + OVERLAP)
        at, scale = times_s[begin : begin + WINDOW], _interval(times_s[first:last])
        spline = make_smoothing_spline((times_s[first:last] - times_s[first]) / scale, values[first:last], lam=penalty)
        parts.append([spline((at - times_s[first]) / scale, order) / scale**order for order in range(3)])
    whole = [np.concatenate([part[order] for part in parts]) for order in range(3)]
    return whole[0], whole[1], whole[2]


def _interval(times_s: Array) -> float:
    """Return the median interval (s); with times in this unit, a penalty has the same effect in every piece."""
    return float(np.median(np.diff(times_s)))


def _chosen(times_s: Array, values: Array) -> float:
    """Return the penalty with the least error in generalised cross-validation.

    Its degrees of freedom are estimated from the response to random signs (Hutchinson's estimate of a trace).
    """
    x = (times_s - times_s[0]) / _interval(times_s)
    probe = np.random.default_rng(0).choice([-1.0, 1.0], len(x))
    best = (np.inf, 0.0)
    for penalty in PENALTIES:
        residual = values - make_smoothing_spline(x, values, lam=penalty)(x)
        freedom = float(probe @ make_smoothing_spline(x, probe, lam=penalty)(x))
        error = float(residual @ residual) / max(len(x) - freedom, 1e-9) ** 2
        best = min(best, (error, float(penalty)))
    return best[1]
