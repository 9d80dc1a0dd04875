# SPDX-License-Identifier: Apache-2.0
"""Which keys given sensors would identify, and what would help most, from the information of simulated runs.

The derivatives have the rows of a real fit: sensors at their rates, divided by their noise.  A further sensor adds
rows, a manoeuvre replaces the run.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from scipy import stats

from mech_twin.declarations.configuration_tree import ConfigurationError, merged_tree
from mech_twin.engine.rollout import RollOut, column_names, roll_out
from mech_twin.measurements.measurement_map import Channel, MeasurementMap
from mech_twin.measurements.units import joint_column
from mech_twin.parameters.load import catalogue_entry, validated
from mech_twin.studies.identification.fit_problem import BEGIN, GAIN, KEY, LAG, ZERO, problem_of
from mech_twin.studies.identification.fit_quality import Fitted
from mech_twin.studies.identification.fit_runs import FitChannel, FitRun
from mech_twin.studies.identification.identification import PREDICTABLE, combined
from mech_twin.studies.identification.intervals import Linearised, inverse_information
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.identification.refits import Refits
from mech_twin.studies.identification.verdicts import (
    IDENTIFIED,
    Combination,
    KeyEvidence,
    KeyVerdict,
    sensitivity,
)

ADDED_NOISE = 1e-3  # noise of a further sensor, in standard deviations of its signal
ADDED_RATE_HZ = 500.0
ROLES = ("linkage", "motor", "body")  # whose motion and effort a sensor can tell


@dataclass(frozen=True)
class Help:
    """Benefit of a further sensor or a manoeuvre.

    Attributes
    ----------
    what : str
        Column of the sensor, or name of the manoeuvre.
    identified : tuple of str
        Keys that would be identified in addition.
    narrowed : float
        Median factor by which the intervals of already identified keys would narrow.
    """

    what: str
    identified: tuple[str, ...]
    narrowed: float


@dataclass(frozen=True)
class SensorPlan:
    """Expected result of a run: verdicts with intervals, combinations, and what would help, best first."""

    keys: tuple[KeyVerdict, ...]
    combinations: tuple[Combination, ...]
    helps: tuple[Help, ...]


def sensor_plan(
    question: IdentificationQuestion,
    sensors: MeasurementMap,
    duration_s: float,
    opened: MeasurementMap | None = None,
    *,
    helps: bool = True,
) -> SensorPlan:
    """Return the expected identification from these sensors in a run of the machine.

    Parameters
    ----------
    sensors : MeasurementMap
        The sensors, each with ``sigma`` or ``quantum``, as for ``simulate --sensors``.
    opened : MeasurementMap, optional
        Map of the fit, with free zeros, gains and lags; the sensors' own if absent.
    helps : bool
        Whether to evaluate further sensors and manoeuvres too.

    Raises
    ------
    ConfigurationError
        A sensor has neither ``sigma`` nor ``quantum``: without noise, everything would be identified.
    """
    pairs = zip((opened or sensors).channels, sensors.channels, strict=True)
    channels = [channel.model_copy(update={"rate_hz": own.rate_hz, "drop": own.drop}) for channel, own in pairs]
    noises = [_noise(channel, place) for place, channel in enumerate(sensors.channels)]
    samples = _sampled(question, _planned("as it is"), channels, noises, duration_s)
    keys, combined = _verdicts(_derivatives(question, samples), together=True)
    found = sensor_helps(question, samples, duration_s) if helps else []
    shown, noises = [each.channel for each in samples.channels], [each.noise for each in samples.channels]
    for asked, run in _manoeuvres(question, duration_s) if helps else ():
        other, _ = _verdicts(_derivatives(asked, _sampled(asked, run, shown, noises, duration_s)))
        found.append(_help(str(run.path), keys, other))
    return SensorPlan(tuple(keys), tuple(combined), tuple(_best_first(found)))


def sensor_helps(question: IdentificationQuestion, samples: FitRun, duration_s: float) -> list[Help]:
    """Return the benefit of each further sensor of a joint's motion or effort, best first.

    Parameters
    ----------
    samples : FitRun
        The run as sampled by the sensors, with their noise.
    """
    added = _further_sensors(question, samples, duration_s)
    over = _derivatives(question, replace(samples, channels=(*samples.channels, *added)))
    count = len(samples.channels)
    before, _ = _verdicts(over, range(count))
    found = [
        _help(f"sensor {channel.name}", before, _verdicts(over, (*range(count), count + i))[0])
        for i, channel in enumerate(added)
    ]
    return _best_first(found)


def _help(what: str, before: Sequence[KeyVerdict], after: Sequence[KeyVerdict]) -> Help:
    """Return the additionally identified keys, and the median factor by which the other intervals narrow."""
    first = {key.key: key.high_95 - key.low_95 for key in before if key.verdict == IDENTIFIED}
    then = {key.key: key.high_95 - key.low_95 for key in after if key.verdict == IDENTIFIED}
    shares = [first[key] / max(then[key], 1e-300) for key in first if key in then]
    return Help(what, tuple(sorted(set(then) - set(first))), float(np.median(shares)) if shares else 1.0)


def _best_first(found: Sequence[Help]) -> list[Help]:
    """Return sensors and manoeuvres that identify a further key or narrow intervals."""
    helps = [each for each in found if each.identified or each.narrowed > 1.0]
    return sorted(helps, key=lambda each: (len(each.identified), each.narrowed), reverse=True)


def _noise(channel: Channel, place: int) -> float:
    """Return the standard deviation of a sensor's noise, quantisation included, in SI units of its column."""
    shown = float(np.hypot(channel.sigma or 0.0, channel.quantum / 12.0**0.5))
    if shown == 0.0:
        raise ConfigurationError(
            f"sensors: key 'channels.{place}.sigma', value {channel.sigma}: expected the noise of {channel.quantity}, "
            "or a quantum"
        )
    gain = 1.0 if isinstance(channel.gain, str) else abs(channel.gain)
    return shown * channel.si_factor * gain


def _sampled(
    question: IdentificationQuestion,
    run: FitRun,
    channels: Sequence[Channel],
    noises: Sequence[float],
    duration_s: float,
) -> FitRun:
    """Return the run as sampled by the sensors: their instants, and the model's values."""
    machine = catalogue_entry(question.machine).build(question.base)
    rolled = roll_out(machine, duration_s, command=run.command or 1.0)
    pairs = zip(channels, noises, strict=True)
    found = [_shown(rolled, channel, noise, duration_s, machine.coupling_step_s) for channel, noise in pairs]
    return replace(run, channels=tuple(each for each in found if len(each.times_s)))


def _shown(rolled: RollOut, channel: Channel, noise: float, duration_s: float, step_s: float) -> FitChannel:
    """Return the samples of a sensor in a simulation, without its noise."""
    parts = channel.quantity.split(".")
    if parts[0] == "event":
        times = rolled.event_numbers.time_s[rolled.event_numbers.kind == parts[1]]
        values = times if parts[2] == "time" else np.linspace(-1.0, 1.0, len(times))
    else:
        times = np.arange(0.0, duration_s, 1.0 / (channel.rate_hz or 1.0 / step_s))
        times = times[: len(times) - round(channel.drop * len(times))] if channel.drop else times
        values = np.interp(times, rolled["time_s"], rolled[channel.quantity])
    return FitChannel(channel, times, values, noise)


def _as_shown(fitted: Fitted) -> Fitted:
    """Return the same with measured values, of events too, replaced by the model's."""
    runs = [
        replace(
            run,
            channels=tuple(
                replace(channel, values=channel.values - off) for channel, off in zip(run.channels, parts, strict=True)
            ),
        )
        for run, parts in zip(fitted.problem.runs, fitted.parts, strict=True)
    ]
    return replace(fitted, problem=fitted.problem.over(runs))


Derivatives = Callable[[float], tuple[Fitted, Linearised]]


def _derivatives(question: IdentificationQuestion, samples: FitRun) -> Derivatives:
    """Return what gives the model as configured over an initial share of a planned run, and derivatives there."""

    @cache
    def over(share: float) -> tuple[Fitted, Linearised]:
        part = samples.within(-np.inf, np.inf).first_share(share)
        problem, sigmas = problem_of(question, [part]), np.array([channel.noise for channel in part.channels])
        x = problem.unknowns.start
        fitted = Fitted(problem, x, problem.comparison(x, sigmas))
        jacobian, other = problem.two_jacobians(x, fitted.comparison)
        counts = [int(mask.sum()) for mask in fitted.comparison.masks[0]]
        rows = np.repeat([*range(len(counts)), -1], [*counts, len(jacobian) - sum(counts)])  # priors at the end
        return fitted, Linearised(jacobian, other, np.zeros(len(rows)), rows, rows, rows)

    return over


def _verdicts(
    over: Derivatives, channels: Sequence[int] | None = None, *, together: bool = False
) -> tuple[list[KeyVerdict], list[Combination]]:
    """Return the expected verdicts, over the longest initial share of the run with reliable derivatives.

    ``channels`` are the indices of the channels used, all if absent.  ``together``: also the identifiable combinations
    of keys.
    """
    for share in (1.0, *PREDICTABLE, 1.0):  # the whole run in any case, if no derivatives are reliable
        fitted, line = over(share)
        line = line if channels is None else line.of_channels(channels)
        unknowns = fitted.problem.unknowns
        places = unknowns.places(KEY)
        seen = sensitivity(line.jacobian, line.other, places, fitted.x[places])
        if not seen.contradicted:
            break
    question = fitted.problem.question
    count = len(question.keys)
    chosen = seen.estimated(range(count))
    kept = np.concatenate([np.array(chosen, dtype=np.intp), unknowns.places(BEGIN, ZERO, GAIN, LAG)])
    student = float(stats.t.ppf(0.975, max(len(line.residuals) - len(kept), 1)))
    errors, halves = np.full(count, np.nan), np.full(count, np.inf)
    own = np.sqrt(np.diag(inverse_information(line.jacobian[:, kept])))
    errors[chosen] = own[: len(chosen)] * unknowns.scales[chosen]
    halves[chosen] = errors[chosen] * student
    values, no_bounds = question.values(), np.tile([[-np.inf], [np.inf]], count)
    fixed = frozenset(set(range(count)) - set(chosen))
    both = np.array([halves, halves])
    found: list[Combination] = []
    if together:
        refits = Refits(_as_shown(fitted), line, 1.0)
        found = combined(question, refits, seen, chosen, both)
    scales = unknowns.scales[:count]
    evidence = KeyEvidence(question.keys, values, values, errors, both, no_bounds, scales, seen, fixed, None, found)
    return evidence.verdicts(), found


def _further_sensors(question: IdentificationQuestion, samples: FitRun, duration_s: float) -> list[FitChannel]:
    """Return the sensors that could be added: of each joint's motion and effort."""
    measured = {channel.name for channel in samples.channels}
    machine = catalogue_entry(question.machine).build(question.base)
    rolled = roll_out(machine, duration_s, command=samples.command or 1.0)
    found = []
    for column in column_names(machine):
        parts = joint_column(column)
        if parts is None or column in measured or parts.role not in ROLES or ".memory." in column:
            continue
        swing = float(np.nanstd(rolled[column]))
        if swing <= 0.0:
            continue
        channel = Channel.model_validate({"source": {"column": column}, "is": column, "rate_hz": ADDED_RATE_HZ})
        found.append(_shown(rolled, channel, ADDED_NOISE * swing, duration_s, machine.coupling_step_s))
    return found


def _planned(name: str, *command: tuple[float, float]) -> FitRun:
    """Return a run that is to be sampled."""
    return FitRun(Path(name), (), command, 0.0)


def _manoeuvres(question: IdentificationQuestion, duration_s: float) -> list[tuple[IdentificationQuestion, FitRun]]:
    """Return other runs of the machine: a step of the speed, the supply off at half time, a start from rest."""
    half = 0.5 * duration_s
    found = [
        (question, _planned("speed step to 0.6 at half time", (0.0, 1.0), (half, 0.6))),
        (question, _planned("supply off at half time", (0.0, 1.0), (half, 0.0))),
    ]
    tree = question.tree
    if tree.get("supply", {}).get("initial_fraction"):
        changed = merged_tree(tree, {"supply": {"initial_fraction": 0.0}})
        started = validated(catalogue_entry(question.machine), changed, "a start from rest")
        found.append((replace(question, base=started), _planned("start from rest")))
    return found
