# SPDX-License-Identifier: Apache-2.0
"""What a long run said of itself, whether its recording is the engine's run, and what of it is a fault."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import median

from diagnostic_msgs.msg import DiagnosticStatus
from footprint import FootprintLog

from mech_twin.engine.run import frames
from mech_twin.messages.step_message import CODECS, body
from mech_twin.nodes.roles.run_control import LOGGED_FROM_S
from mech_twin.recording.bag_reader import open_bag
from mech_twin.recording.bag_samples import BagSamples
from mech_twin.roles import Machine
from mech_twin.studies.resimulation import Difference, first_difference

SERVER = "view server"
GROWTH_LIMIT_MIB = 10.0  # of the settled time
SERVER_SETTLES_IN_S = 1200.0  # a history that is not full yet grows: not a fault of a shorter run
LOSSES = (" missing", " malformed", " conflicting", " timeout")
LOST_IN_RECORDING = ("dropped", "missed")  # one that is late was repeated by a run that waits
UNDER_WAY = 2  # steps at the end of a recording whose answers may still have been on their way
FOREVER_S = 1e6
TOLD_EVERY = 1000  # steps


class Told:
    """What the nodes said of themselves in their diagnostics."""

    def __init__(self, limits: Mapping[str, float]) -> None:
        self.worst = 0.0
        self.worst_lag_s = self.given_up_s = 0.0
        self.lags_s: list[tuple[float, float]] = []
        self.losses: dict[str, int] = {}
        self.errors: set[str] = set()
        self._limits = limits

    def hear(self, at_s: float, statuses: list[DiagnosticStatus]) -> None:
        """Take statuses into account."""
        for status in statuses:
            if status.level == DiagnosticStatus.ERROR:
                self.errors.add(f"{status.name}: {status.message}")
            for pair in status.values:
                self._value(at_s, status.name, pair.key, pair.value)

    def lags_after(self, at_s: float) -> list[float]:
        """Return the lag of every window from a time on, the last one at least."""
        return [lag for when, lag in self.lags_s if when >= at_s] or [lag for _, lag in self.lags_s[-1:]]

    def _value(self, at_s: float, node: str, key: str, value: str) -> None:
        residual = key.removeprefix("worst ")
        if residual in self._limits:
            self.worst = max(self.worst, float(value) / self._limits[residual])
        elif key == "lag s":
            self.lags_s.append((at_s, float(value)))
        elif key == "worst lag s":
            self.worst_lag_s = max(self.worst_lag_s, float(value))
        elif key == "given up s":
            self.given_up_s = max(self.given_up_s, float(value))
        elif key.endswith(LOSSES) and int(value):
            self.losses[f"{node} {key}"] = int(value)


class Comparison:
    """A recording held against the engine: every sample of every step, to the bit.

    Attributes
    ----------
    steps : int
        Steps compared so far.
    missing : int
        Samples that the run had and the recording has not, but for those of the last steps.
    first : Difference or None
        The first difference, which ends the comparison.
    lost : dict of str to int
        What the recorder says it lost, by topic and kind.
    complete : bool
        Whether the whole recording was compared.
    """

    def __init__(self) -> None:
        self.steps = self.missing = 0
        self.first: Difference | None = None
        self.lost: dict[str, int] = {}
        self.complete = False

    def run(self, bag: Path, machine: Machine, told: Callable[[int], None] = lambda step: None) -> None:
        """Compare, telling the step now and then; what was compared until an interruption stands in the attributes."""
        engine = frames(machine, FOREVER_S)
        fields = [codec.field for codec in CODECS if machine.body is not None or codec is not body]
        late: deque[int] = deque([0] * UNDER_WAY)
        with open_bag(bag) as reader:
            for topic, row in reader.info.counters.items():
                self.lost |= {f"{topic} {kind}": row[kind] for kind in LOST_IN_RECORDING if row.get(kind)}
            for known in BagSamples(reader, machine.coupling_step_s).steps():
                frame = next(engine)
                while frame.linkage.step < known.step:
                    late.append(len(fields))
                    self.missing += late.popleft()
                    frame = next(engine)
                pairs = [(name, getattr(known, name), getattr(frame, name)) for name in fields]
                for name, recorded, computed in pairs:
                    self.first = self.first or (recorded and first_difference(name, recorded, computed))
                if self.first is not None:
                    return
                late.append(sum(recorded is None for _, recorded, _ in pairs))
                self.missing += late.popleft()
                self.steps += 1
                if self.steps % TOLD_EVERY == 0:
                    told(known.step)
        self.complete = True


def faults(told: Told, log: FootprintLog, compared: Comparison, realtime: bool) -> list[str]:
    """Return one line for everything about a long run that must not be."""
    lines = sorted(told.errors)
    lines += [f"{name}: {number}" for name, number in {**told.losses, **compared.lost}.items()]
    lines += [f"{compared.missing} samples are not in the recording"] * bool(compared.missing)
    lines += [f"not the engine's: {compared.first}"] * (compared.first is not None)
    lines += ["no step was compared"] * (compared.steps == 0)
    if realtime:
        lines += [f"{told.given_up_s:.1f} s were given up"] * bool(told.given_up_s)
        behind = [lag for lag in told.lags_after(log.settled_from_s()) if lag >= LOGGED_FROM_S]
        if behind:
            lines.append(f"behind by up to {max(behind):.2f} s in {len(behind)} windows")
    for role in log.rows:
        grown = log.growth_mib(role)
        settles = role == SERVER and log.duration_s() < SERVER_SETTLES_IN_S
        lines += [f"{role} grew by {grown:.1f} MiB"] * (grown > GROWTH_LIMIT_MIB and not settles)
    return lines


def lag_cell(told: Told, log: FootprintLog) -> str:
    """Return what a row says of the lag."""
    lags = told.lags_after(log.settled_from_s())
    if not lags:
        return "-"
    usual = f"settled: {median(lags) * 1e3:.1f} ms, at most {max(lags):.2f} s"
    return f"{usual}; from the start on at most {told.worst_lag_s:.2f} s; {told.given_up_s:.0f} s given up"


def memory_cell(log: FootprintLog) -> str:
    """Return what a row says of memory."""
    return ", ".join(
        f"{role} {log.settled(role)[-1].memory_mib:.0f} MiB ({log.growth_mib(role):+.1f})" for role in log.rows
    )
