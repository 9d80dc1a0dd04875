# SPDX-License-Identifier: Apache-2.0
"""Inverse dynamics of a measured motion: every joint, and the forces that the motion requires."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.trajectory import force_numbers, joint_numbers
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.crank_motion import CrankMotion
from mech_twin.measurements.measurement_map import fixed
from mech_twin.measurements.runs import MeasuredChannel, MeasuredRun
from mech_twin.roles import CrankState, GuidedLinkage, Machine
from mech_twin.samples import ForceSample, LinkageSample

BODY = "linkage.body"


def guided_samples(
    machine: Machine, motion: CrankMotion, run: MeasuredRun
) -> Iterator[tuple[LinkageSample, ForceSample]]:
    """Yield linkage and force samples at each instant of the crank's channel.

    Raises
    ------
    ConfigurationError
        The machine's state is not a function of its crank motion.
    """
    if not isinstance(machine.linkage, GuidedLinkage):
        raise ConfigurationError(
            f"{machine.name}: its state does not follow from a measured crank; expected mb10_breaker, compaction_press "
            "or vibration_crank"
        )
    body = run.channel(f"{BODY}.position")
    rate = run.channel(f"{BODY}.velocity")
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
    """A measured channel compared with the model in the same motion."""

    name: str
    samples: int
    rms: float
    rms_measured: float
    correlation: float

    @property
    def share(self) -> float:
        """Rms difference over the rms of the measurement about its mean."""
        return self.rms / self.rms_measured if self.rms_measured > 0.0 else float(self.rms > 0.0)


@dataclass
class MeasuredForces:
    """Largest forces of a measured run, and its other channels compared with the model."""

    samples: int = 0
    largest: dict[str, float] = field(default_factory=dict)
    compared: list[Compared] = field(default_factory=list)


def measured_forces(
    samples: Iterator[tuple[LinkageSample, ForceSample]], run: MeasuredRun, crank: str
) -> MeasuredForces:
    """Return the largest forces of the motion, and each channel but the crank compared with the model.

    A channel is compared at its own instants; an unknown zero is the mean difference, an unknown gain is fitted.
    """
    others = [channel for channel in run.channels if channel.name != crank]
    columns: dict[str, list[float]] = {channel.name: [] for channel in others}
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
    model = {name: np.array(values) for name, values in columns.items()}
    found.compared = _compared(others, model | {"time_s": np.array(times_s)})
    return found


def _compared(channels: Sequence[MeasuredChannel], model: Mapping[str, Array]) -> list[Compared]:
    found = []
    for channel in channels:
        values = model[channel.name]
        inside = (channel.times_s >= model["time_s"][0]) & (channel.times_s <= model["time_s"][-1])
        if not inside.any() or not np.isfinite(values).all():
            continue
        expected = np.interp(channel.times_s[inside], model["time_s"], values)
        measured = channel.values[inside]
        if isinstance(channel.channel.gain, str):
            measured = measured * float(measured @ expected) / float(measured @ measured)
        if fixed(channel.channel.zero, np.nan) != channel.channel.zero:
            measured = measured - float(np.mean(measured - expected))
        spread = measured.std() * expected.std()
        correlation = (
            float(np.mean((measured - measured.mean()) * (expected - expected.mean())) / spread) if spread else 0.0
        )
        rms = float(np.sqrt(np.mean((measured - expected) ** 2)))
        size = float(np.sqrt(np.mean((measured - measured.mean()) ** 2)))
        found.append(Compared(channel.name, len(measured), rms, size, correlation))
    return found
