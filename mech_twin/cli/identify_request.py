# SPDX-License-Identifier: Apache-2.0
"""What `mech-twin identify` was asked for, and which runs it fits."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from mech_twin.cli.console import print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.measurement_verbs import IdentifyVerb
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.results.opened_runs import given_map

FEWEST_RUNS_TO_HOLD_OUT = 3
DEFAULT_SHARE = 0.2
LATEST_BEGIN_S = 10.0
LARGEST_SHARE = 0.8


class IdentifyRequest(IdentifyVerb):
    """What `mech-twin identify` was asked for, and what its options mean."""

    @cached_property
    def given_map(self) -> MeasurementMap:
        """The map, checked to be of this machine; where none is given, the one proposed for the runs."""
        if self.map_file is None:
            from mech_twin.cli.map import proposal

            proposed = proposal(self.runs, self.built)
            say(f"map, as `mech-twin map` proposes it:\n{proposed.text.rstrip()}")
            return proposed.known
        return given_map(self.map_file, self.built)

    @property
    def begin_bound_s(self) -> float:
        """The latest beginning of a run within the machine's own."""
        if self.begin != "unknown":
            return 0.0
        return LATEST_BEGIN_S if self.latest_begin_s is None else self.latest_begin_s

    @property
    def held_out_run(self) -> Path | None:
        """The run that was asked to be held out; None where nothing or a share was."""
        return None if self.hold_out is None or self.held_out_share is not None else Path(self.hold_out)

    @property
    def held_out_share(self) -> float | None:
        """The share that was asked to be held out."""
        try:
            share = float(self.hold_out or "")
        except ValueError:
            return None
        if not 0.0 <= share <= LARGEST_SHARE:
            raise CommandError(f"--hold-out {self.hold_out}: expected a run, or a share from 0 to {LARGEST_SHARE:g}")
        return share


def split_runs(runs: Sequence[Path], held_out: Path | None) -> tuple[list[Path], Path | None]:
    """Return the runs that are fitted, and the one held out: as asked, else the last of three or more."""
    every = list(runs)
    if held_out is None:
        return (every[:-1], every[-1]) if len(every) >= FEWEST_RUNS_TO_HOLD_OUT else (every, None)
    if held_out not in every or len(every) < 2:
        raise CommandError(f"--hold-out {held_out}: expected one of at least two runs")
    return [run for run in every if run != held_out], held_out


def bounded_keys(texts: Sequence[str]) -> tuple[tuple[str, ...], dict[str, tuple[float, float]]]:
    """Return the keys written as ``KEY`` or ``KEY=LOW:HIGH``, and the bounds of those that have some."""
    keys, bounds = [], {}
    for text in texts:
        key, equals, numbers = text.partition("=")
        keys.append(key.strip())
        if not equals:
            continue
        bounds[key.strip()] = low, high = _pair("--free", text, numbers, ":", "KEY=LOW:HIGH")
        if not low < high:
            raise CommandError(f"--free {text}: expected LOW below HIGH")
    return tuple(dict.fromkeys(keys)), bounds


def prior_keys(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Return mean and standard deviation of the keys written as ``KEY=MEAN,SD``."""
    found = {}
    for text in texts:
        key, _, numbers = text.partition("=")
        found[key.strip()] = _, deviation = _pair("--prior", text, numbers, ",", "KEY=MEAN,SD")
        if not deviation > 0.0:
            raise CommandError(f"--prior {text}: expected a standard deviation above 0")
    return found


def _pair(option: str, text: str, numbers: str, between: str, form: str) -> tuple[float, float]:
    first, _, second = numbers.partition(between)
    try:
        return float(first), float(second)
    except ValueError:
        raise CommandError(f"{option} {text}: expected {form}, with numbers") from None


def show_keys(title: str, keys: Sequence[Any]) -> None:
    """Print the keys with their intervals and verdicts."""
    heads = ("key", "before", "estimate", "95 % from", "to", "verdict")
    rows = [(k.key, k.before, k.estimate, k.low_95, k.high_95, k.verdict) for k in keys]
    print_table(title, heads, rows)
