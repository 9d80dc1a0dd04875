# SPDX-License-Identifier: Apache-2.0
"""The scene of a run, on a bench or in a file for rerun: curves of each role, headline, notes over the drawing."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from mech_twin.capabilities.mechanism import FrameTree
from mech_twin.process.closing import Closing
from mech_twin.roles import Machine
from mech_twin.samples import Event, Sample
from mech_twin.view.annotations import Annotations, AnyStep, Banner, lost_energy
from mech_twin.view.bench.picture import Curves
from mech_twin.view.curve_groups import Groups, body_groups, force_groups, linkage_groups, motor_groups, same_names
from mech_twin.view.sending import Sending, extreme_rows

KEPT_SAMPLES = 4000  # per role, while the bench accepts none


class _Role:
    """The samples of one role since the last picture."""

    def __init__(self, groups: Callable[[Sequence[Any]], Groups]) -> None:
        self._groups = groups
        self._samples: deque[Any] = deque(maxlen=KEPT_SAMPLES)
        self.units: dict[str, str] = {}

    @property
    def waiting(self) -> bool:
        """Whether there are samples."""
        return bool(self._samples)

    def spans(self, span_s: float) -> bool:
        """Return whether the samples come to this time (s), or are as many as are kept."""
        kept = self._samples
        return len(kept) == KEPT_SAMPLES or (bool(kept) and kept[-1].time_s - kept[0].time_s >= span_s)

    def add(self, sample: Sample) -> None:
        """Add a sample."""
        self._samples.append(sample)

    def taken(self, sending: Sending) -> Iterator[Curves]:
        """Remove the samples, and yield their curves, decimated with their extremes."""
        samples, self._samples = self._samples, deque(maxlen=KEPT_SAMPLES)
        while samples:
            batch = [samples.popleft()]
            while samples and same_names(batch[0], samples[0]):
                batch.append(samples.popleft())
            time_s, step = (np.array([getattr(sample, name) for sample in batch]) for name in ("time_s", "step"))
            span_s = (time_s[-1] - time_s[0]) / max(len(batch) - 1, 1)
            window = max(sending.window, round(sending.window_s / span_s)) if span_s > 0.0 else sending.window
            for group in self._groups(batch):
                if group.names:
                    self.units[group.path] = group.unit
                    rows = extreme_rows(group.values, window)
                    yield Curves(group.path, group.names, time_s[rows], group.values[rows], step[rows])


class RoleCurves:
    """The samples of all roles since the last picture."""

    def __init__(self, sliding: frozenset[str] = frozenset()) -> None:
        self.sliding = sliding
        self._roles = (
            _Role(lambda samples: motor_groups(samples, self.sliding)),
            _Role(lambda samples: linkage_groups(samples, self.sliding)),
            _Role(force_groups),
            _Role(body_groups),
        )

    @property
    def units(self) -> dict[str, str]:
        """The unit of each entity path, empty if given by its kind."""
        return {path: unit for role in self._roles for path, unit in role.units.items()}

    def add(self, step: AnyStep) -> None:
        """Add the samples of a step."""
        for role, sample in zip(self._roles, (step.motor, step.linkage, step.forces, step.body), strict=True):
            if sample is not None:
                role.add(sample)

    @property
    def waiting(self) -> bool:
        """Whether there are samples since the last picture."""
        return any(role.waiting for role in self._roles)

    def spans(self, span_s: float) -> bool:
        """Return whether the samples of a role come to this time (s), or are as many as are kept."""
        return any(role.spans(span_s) for role in self._roles)

    def taken(self, sending: Sending) -> list[Curves]:
        """Remove the samples, and return their curves, decimated with their extremes."""
        return [curve for role in self._roles for curve in role.taken(sending)]


class RunScene(Closing):
    """What every scene of a run keeps; a context manager."""

    def __init__(self) -> None:
        self._roles = RoleCurves()
        self._banner = Banner(None)
        self._annotations: Annotations | None = None
        self._turning_stops: frozenset[str] = frozenset()

    def watch(self, machine: Machine) -> None:
        """Add what the machine tells; call before the first step."""
        self._banner.watch(machine)
        if machine.mechanism is not None:
            self.know(machine.mechanism, machine.blow_energy)

    def know(self, tree: FrameTree, blow_energy: Callable[[Event], float] | None = None) -> None:
        """Add what needs the machine's frames: pin reactions, blows, units of joints; call before the first step.

        ``blow_energy`` returns the energy of an impact (J); by default the energy lost by the mechanism.
        """
        energy = lost_energy if blow_energy is None else blow_energy
        self._roles.sliding, self._turning_stops = tree.sliding_joints, tree.turning_stops
        self._banner.know(tree, energy)
        self._annotations = Annotations(tree, energy)

    def _take(self, step: AnyStep) -> None:
        """Add the samples of a step, all or some."""
        self._banner.add(step)
        if self._annotations is not None and step.linkage is not None:
            self._annotations.add(step.linkage, step.forces)
        self._roles.add(step)

    def _strike(self, event: Event) -> None:
        """Add an event to headline and drawing."""
        self._banner.strike(event)
        if self._annotations is not None:
            self._annotations.strike(event)
