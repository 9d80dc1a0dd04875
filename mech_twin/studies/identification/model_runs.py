# SPDX-License-Identifier: Apache-2.0
"""Simulations for values of the free keys, with the command of each measured run; the last ones are cached."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.engine.rollout import RollOut, roll_out
from mech_twin.measurements.blocks import Array
from mech_twin.parameters.load import catalogue_entry
from mech_twin.studies.identification.channel_prediction import ColumnCurves, needed_columns
from mech_twin.studies.identification.fit_runs import FitRun
from mech_twin.studies.identification.keyed_configuration import KeyedConfiguration, number_at
from mech_twin.studies.named_rollouts import rollouts

Curves = tuple[ColumnCurves, ...]
KEPT = 3  # simulations


class ModelRuns:
    """Simulations of a machine for comparison with measured runs.

    Parameters
    ----------
    keyed : KeyedConfiguration
        The machine and its free keys.
    runs : sequence of FitRun
        The measured runs.
    longest_begin_s : float
        Latest start of a run whose start is unknown, as time since the machine's start.
    cores : int, optional
        Threads; all cores if absent.
    """

    def __init__(
        self, keyed: KeyedConfiguration, runs: Sequence[FitRun], longest_begin_s: float = 0.0, cores: int | None = None
    ) -> None:
        keyed.check()
        self.keyed, self.runs, self.rolled_out = keyed, tuple(runs), 0
        self._cores, self._longest_begin_s = cores, longest_begin_s
        names = [channel.name for run in runs for channel in run.channels if not channel.of_events]
        self._columns = needed_columns(names)
        self._kept: dict[bytes, Curves | None] = {}

    def over(self, runs: Sequence[FitRun]) -> ModelRuns:
        """Return the same machine with other parts of the runs."""
        return ModelRuns(self.keyed, runs, self._longest_begin_s, self._cores)

    def at(self, values: Array) -> Curves | None:
        """Return the columns of each run for these values of the keys; None if they are rejected or a run fails."""
        self.prepare([values])
        return self._kept[values.tobytes()]

    def prepare(self, members: Sequence[Array]) -> None:
        """Compute what `at` will be asked for, at most `KEPT` sets of values, on all cores."""
        lacking = [values for values in members if values.tobytes() not in self._kept]
        if lacking:
            found = zip((values.tobytes() for values in lacking), self.many(lacking), strict=True)
            self._kept = dict([*self._kept.items(), *found][-KEPT:])

    def many(self, members: Sequence[Array]) -> list[Curves | None]:
        """Return the same for several sets of values, computed on all cores."""
        configured = [self._parameters(values) for values in members]
        legal = [each for each in configured if each is not None]
        columns: list[list[ColumnCurves | None]] = [[] for _ in legal]
        for run in self.runs:
            for place, curves in enumerate(self._rolled(run, legal)):
                columns[place].append(curves)
        whole = iter(columns)
        found: list[Curves | None] = []
        for each in configured:
            rolled = [] if each is None else next(whole)
            kept = tuple(curves for curves in rolled if curves is not None)
            found.append(kept if rolled and len(kept) == len(self.runs) else None)
        return found

    @property
    def step_s(self) -> float:
        """The coupling step."""
        return number_at(self.keyed.tree, "coupling.step_s", self.keyed.name)

    def duration_s(self, run: FitRun) -> float:
        """Return the duration of the simulation that a measured run needs (s)."""
        begin = self._longest_begin_s if run.begin_s is None else run.begin_s
        return max(min(run.last_s, run.until_s), 0.0) + begin

    def _rolled(self, run: FitRun, configured: Sequence[Parameters]) -> list[ColumnCurves | None]:
        if not configured:
            return []
        duration_s = self.duration_s(run) + 2.0 * self.step_s
        command = run.command or 1.0
        self.rolled_out += len(configured)
        members: Iterable[RollOut]
        if len(configured) == 1 or self._cores == 1:  # without the overhead of threads
            entry = catalogue_entry(self.keyed.name)
            members = [roll_out(entry.build(each), duration_s, self._columns, None, command) for each in configured]
        else:
            members = rollouts(
                self.keyed.name,
                duration_s,
                list(configured),
                columns=self._columns,
                commands=[command] * len(configured),
                cores=self._cores,
            )
        return [None if member.error is not None else ColumnCurves(member) for member in members]

    def _parameters(self, values: Array) -> Parameters | None:
        if not np.isfinite(values).all():
            return None
        try:
            return self.keyed.parameters(values)
        except ConfigurationError:
            return None
