# SPDX-License-Identifier: Apache-2.0
"""The scene of a run, on a bench or in a file for rerun: curves of each role, headline, notes over the drawing."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from mech_twin.capabilities.mechanism import FrameTree
from mech_twin.process.closing import Closing
from mech_twin.roles import Machine
from mech_twin.samples import Event
from mech_twin.view.annotations import Annotations, AnyStep, Banner, lost_energy
from mech_twin.view.bench.picture import Curves
from mech_twin.view.curve_groups import Groups, body_groups, force_groups, linkage_groups, motor_groups, same_names
from mech_twin.view.sending import PictureRate, extreme_rows

KEPT_SAMPLES = 4000  # per role, while the bench accepts none


class RoleCurves:
    """The samples of all roles since the last picture.

    Attributes
    ----------
    units : dict
        The unit of each entity path, empty if given by its kind.
    """

    def __init__(self, sliding: frozenset[str] = frozenset()) -> None:
        self.sliding = sliding
        self.units: dict[str, str] = {}
        self._samples = tuple(deque[Any](maxlen=KEPT_SAMPLES) for _ in range(4))  # motor, linkage, forces, body

    def add(self, step: AnyStep) -> None:
        """Add the samples of a step."""
        for kept, sample in zip(self._samples, (step.motor, step.linkage, step.forces, step.body), strict=True):
            if sample is not None:
                kept.append(sample)

    @property
    def waiting(self) -> bool:
        """Whether there are samples since the last picture."""
        return any(self._samples)

    def spans(self, span_s: float) -> bool:
        """Return whether the samples of a role come to this time (s), or are as many as are kept."""
        return any(
            len(kept) == KEPT_SAMPLES or kept[-1].time_s - kept[0].time_s >= span_s for kept in self._samples if kept
        )

    def taken(self, sending: PictureRate) -> list[Curves]:
        """Remove the samples, and return their curves, decimated with their extremes."""
        motor, linkage, forces, body = self._samples
        return [
            *self._curves(motor, lambda batch: motor_groups(batch, self.sliding), sending),
            *self._curves(linkage, lambda batch: linkage_groups(batch, self.sliding), sending),
            *self._curves(forces, force_groups, sending),
            *self._curves(body, body_groups, sending),
        ]

    def _curves(
        self, samples: deque[Any], groups: Callable[[Sequence[Any]], Groups], sending: PictureRate
    ) -> Iterator[Curves]:
        while samples:
            batch = [samples.popleft()]
            while samples and same_names(batch[0], samples[0]):
                batch.append(samples.popleft())
            time_s, step = (np.array([getattr(sample, name) for sample in batch]) for name in ("time_s", "step"))
            span_s = (time_s[-1] - time_s[0]) / max(len(batch) - 1, 1)
            window = max(sending.window, round(sending.window_s / span_s)) if span_s > 0.0 else sending.window
            for group in groups(batch):
                if group.names:
                    self.units[group.path] = group.unit
                    rows = extreme_rows(group.values, window)
                    yield Curves(group.path, group.names, time_s[rows], group.values[rows], step[rows])


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
