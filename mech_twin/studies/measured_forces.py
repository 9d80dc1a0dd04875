# SPDX-License-Identifier: Apache-2.0
"""Inverse dynamics of a measured motion: every joint, and the forces that the motion requires."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.trajectory import force_numbers, joint_numbers
from mech_twin.errors import MeasurementError
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.crank_motion import CrankMotion
from mech_twin.measurements.measurement_map import fixed
from mech_twin.measurements.runs import MeasuredChannel, MeasuredRun
from mech_twin.measurements.units import TURN, is_angle
from mech_twin.roles import CrankState, GuidedLinkage, Machine
from mech_twin.samples import ForceSample, LinkageSample

BODY = ("linkage.body.position", "linkage.body.velocity")
LAGS, LAG_S = 73, 1e-7  # lags tried first, and how near the best is come to
FAR = TURN / 3.0  # between two samples of the crank: farther apart they tell no motion between them


def guided_samples(
    machine: Machine, motion: CrankMotion, run: MeasuredRun
) -> Iterator[tuple[LinkageSample, ForceSample]]:
    """Yield linkage and force samples at each instant of the crank's channel.

    Raises
    ------
    ConfigurationError
        The machine's state is not a function of its crank motion.
    MeasurementError
        Zero or gain of the body's motion is unknown.
    """
    if not isinstance(machine.linkage, GuidedLinkage):
        raise ConfigurationError(
            f"{machine.name}: its state does not follow from a measured crank; expected mb10_breaker, compaction_press "
            "or vibration_crank"
        )
    body, rate = (run.channel(name) for name in BODY)
    for channel in filter(None, (body, rate)):
        for key in ("zero", "gain"):
            if isinstance(value := getattr(channel.channel, key), str):
                words = f"the {key} of {channel.name} is {value}, and the forces follow from it; expected a number"
                raise MeasurementError(run.path, f"{words}. Without this channel the body rests on its collar")
    bodies = (
        [None] * len(motion.times_s) if body is None else np.interp(motion.times_s, body.times_s, body.values).tolist()
    )
    rates = [0.0] * len(bodies) if rate is None else np.interp(motion.times_s, rate.times_s, rate.values).tolist()
    columns = (motion.times_s, motion.angle_rad, motion.speed_rad_per_s, motion.acceleration_rad_per_s2)
    for step, (time_s, q, u, a) in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
        linkage = machine.linkage.guided(step, time_s, CrankState(q, u, a, bodies[step], rates[step]))
        yield linkage, machine.forces.analyse(linkage)


@dataclass
class Compared:
    """A measured channel compared with the model in the same motion.

    The rms of a measurement whose zero says nothing, a position or one under a zero that was found, is about its mean.
    ``found`` are its zero (channel's unit), gain and lag (s) as the comparison found them, where the map knows none.
    """

    name: str
    samples: int
    rms: float
    rms_measured: float
    correlation: float
    found: dict[str, float] = field(default_factory=dict)

    @property
    def share(self) -> float:
        """Rms difference over the rms of the measurement."""
        return self.rms / self.rms_measured if self.rms_measured > 0.0 else float(self.rms > 0.0)


@dataclass
class MeasuredForces:
    """Largest forces of a measured run, its other channels compared with the model, and why some are not."""

    samples: int = 0
    largest: dict[str, float] = field(default_factory=dict)
    compared: list[Compared] = field(default_factory=list)
    left_out: dict[str, list[str]] = field(default_factory=dict)


def measured_forces(
    samples: Iterator[tuple[LinkageSample, ForceSample]], run: MeasuredRun, crank: str
) -> MeasuredForces:
    """Return the largest forces of the motion, and each channel but those that give it compared with the model.

    A channel is compared at its own instants.  Its unknown zero, gain and lag are those that bring it nearest to the
    model, a lag of at most half a turn and an eighth of the run; an angle may be off by whole turns.
    """
    given = [run.channel(name) for name in (crank, *BODY)]
    others = [channel for channel in run.channels if all(channel is not each for each in given)]
    columns: dict[str, list[float]] = {name: [] for name in (crank, *(channel.name for channel in others))}
    times_s: list[float] = []
    found = MeasuredForces()
    for linkage, forces in samples:
        found.samples += 1
        row = {**dict(joint_numbers("linkage", linkage)), **dict(force_numbers(forces))}
        for name, value in row.items():
            if name.startswith("forces.") or name.endswith(".effort"):
                found.largest[name] = max(found.largest.get(name, 0.0), abs(value))
        times_s.append(linkage.time_s)
        for name, values in columns.items():
            values.append(row.get(name, float("nan")))
    # the crank counts its turns, also over a gap
    model = {
        name: np.unwrap(values) if is_angle(name) and name != crank else np.array(values)
        for name, values in columns.items()
    }
    at_s = np.array(times_s)
    turned = float(np.ptp(model[crank]))
    known = np.abs(np.diff(model[crank])) <= FAR
    longest_s = float(at_s[-1] - at_s[0]) * min(0.5 * TURN / turned, 0.125) if turned else 0.0
    for channel in others:
        if not np.isfinite(model[channel.name]).all():
            found.left_out.setdefault("the motion tells linkage and forces only", []).append(channel.name)
        elif channel.times_s[-1] < at_s[0] or channel.times_s[0] > at_s[-1]:
            why = f"none of their samples is between {at_s[0]:.6g} and {at_s[-1]:.6g} s, when {crank} is measured"
            found.left_out.setdefault(why, []).append(channel.name)
        else:
            found.compared.append(_beside_model(channel, at_s, model[channel.name], longest_s, known))
    return found


def _beside_model(
    channel: MeasuredChannel, at_s: Array, values: Array, longest_lag_s: float, known: npt.NDArray[np.bool_]
) -> Compared:
    """Return a channel compared with the model's values at these times, under the lag of the map or the nearest one.

    ``known``, shape (times - 1,), says in which intervals the motion is known; samples in others are left out.
    """
    model = CubicSpline(at_s, values)

    def delayed(lag_s: float, margin_s: float = 0.0) -> Compared:
        inside = (channel.times_s - lag_s >= at_s[0]) & (channel.times_s - lag_s <= at_s[-1])
        if margin_s:  # the same samples at every lag
            inside = (channel.times_s >= at_s[0] + margin_s) & (channel.times_s <= at_s[-1] - margin_s)
        inside &= known[np.clip(np.searchsorted(at_s, channel.times_s - lag_s) - 1, 0, len(known) - 1)]
        expected = model(channel.times_s[inside] - lag_s)
        return _nearest(channel, channel.values[inside], expected)

    if not isinstance(channel.channel.lag_s, str) or not delayed(0.0, longest_lag_s).samples:
        return delayed(0.0)
    lags_s, step_s = np.linspace(-longest_lag_s, longest_lag_s, LAGS, retstep=True)
    coarse_s = min(lags_s.tolist(), key=lambda lag_s: delayed(lag_s, longest_lag_s).rms)
    ends = (coarse_s - float(step_s), coarse_s + float(step_s))
    found = minimize_scalar(
        lambda lag_s: delayed(lag_s, longest_lag_s).rms, bounds=ends, method="bounded", options={"xatol": LAG_S}
    )
    nearest = delayed(float(found.x))
    if nearest.rms >= np.std(values):  # the model hardly moves: no lag is nearer than another but by noise
        return delayed(0.0)
    nearest.found["lag_s"] = float(found.x)
    return nearest


def _nearest(channel: MeasuredChannel, measured: Array, expected: Array) -> Compared:
    """Return a channel compared with what is expected of it, under the zero and gain of the map or the nearest ones."""
    if not len(measured):
        return Compared(channel.name, 0, np.inf, 0.0, 0.0)
    about, found = channel.channel, dict[str, float]()
    count = about.sign * about.si_factor * fixed(about.gain, 1.0)
    if isinstance(about.gain, str):
        origin = (measured.mean(), expected.mean()) if isinstance(about.zero, str) else (0.0, 0.0)
        moved = measured - origin[0]
        power = float(moved @ moved) if np.ptp(measured) > 0.0 else 0.0
        found["gain"] = float(moved @ (expected - origin[1])) / power if power else 0.0
        measured, count = found["gain"] * measured, found["gain"] * count
    offset = float(np.mean(measured - expected))
    if isinstance(about.zero, str):
        measured = measured - offset
        if count:
            found["zero"] = offset / count
    elif is_angle(channel.name):
        measured = measured - TURN * round(offset / TURN)
    spread = measured.std() * expected.std()
    together = float(np.mean((measured - measured.mean()) * (expected - expected.mean())))
    rms = float(np.sqrt(np.mean((measured - expected) ** 2)))
    own_zero = not isinstance(about.zero, str) and not channel.name.endswith(".position")
    size = float(np.sqrt(np.mean(measured**2)) if own_zero else measured.std())
    return Compared(channel.name, len(measured), rms, size, together / float(spread) if spread else 0.0, found)
