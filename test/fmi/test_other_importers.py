# SPDX-License-Identifier: Apache-2.0
"""A unit in importers that share no code with FMPy: libcosim of DNV, fmusim of the Modelica Association."""

from __future__ import annotations

import csv
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimManipulator import CosimManipulator
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

import mech_twin as mt

STEP_S, STEPS = 0.001, 600
COLUMNS = ["linkage.mass.position", "linkage.mass.velocity", "forces.stop.force_x_n"]
FMUSIM = shutil.which("fmusim")
with_fmusim = pytest.mark.skipif(FMUSIM is None, reason="no fmusim: .ci/fmusim.sh builds it")


def in_libcosim(file: Path, names: list[str], changes: dict[int, dict[str, float]]) -> dict[str, list[float]]:
    """Return what libcosim reads after every step, inputs changed before some."""
    log_output_level(CosimLogLevel.WARNING)
    run = CosimExecution.from_step_size(round(1e9 * STEP_S))
    place = run.add_local_slave(CosimLocalSlave(fmu_path=str(file), instance_name="one"))
    observer, hand = CosimObserver.create_last_value(), CosimManipulator.create_override()
    run.add_observer(observer)
    run.add_manipulator(hand)
    references = {each.name.decode(): each.reference for each in run.slave_variables(place)}
    rows = []
    for step in range(STEPS):
        for name, value in changes.get(step, {}).items():
            assert hand.slave_real_values(place, [references[name]], [value])
        assert run.step()
        rows.append(observer.last_real_values(place, [references[name] for name in names]))
    return dict(zip(names, map(list, zip(*rows, strict=True)), strict=True))


def impacts(run: Any) -> np.ndarray:
    """Return the time of the last impact so far at the end of every step after the first, 0 before there was one."""
    of_kind = run.event_numbers.kind == "impact"
    found = np.zeros(STEPS + 1)
    for step, time_s in zip(run.event_numbers.step[of_kind], run.event_numbers.time_s[of_kind], strict=True):
        found[step:] = time_s
    return found[1:]


@pytest.mark.slow
@pytest.mark.parametrize("changed", [False, True])
def test_libcosim_reads_every_number_and_impact_of_a_run_to_the_bit(unit: Any, changed: bool) -> None:
    given = {"phase1_force_n": 900.0}
    at = {299: {f"live.{key}": value for key, value in given.items()}} if changed else {}
    run = mt.rollout("impact_mass", STEP_S * STEPS, changes=[(0.3, given)] if changed else [])
    names = [name for name in COLUMNS if name in run.columns]
    found = in_libcosim(unit("impact_mass", 2), [*names, "event.impact.time_s"], at)
    assert found.pop("event.impact.time_s") == impacts(run).tolist()
    assert {name: run[name][1:].tolist() for name in names} == found
    plain = mt.rollout("impact_mass", STEP_S * STEPS)
    assert (found[names[0]] == plain[names[0]][1:].tolist()) is not changed


def in_fmusim(file: Path, names: list[str], *words: str) -> list[dict[str, float]]:
    assert FMUSIM is not None
    asked = [word for name in names for word in ("--output-variable", name)]
    out = file.with_suffix(".csv")
    interval = ["--output-interval", repr(STEP_S), "--output-file", str(out)]
    subprocess.run([FMUSIM, *interval, *asked, *words, str(file)], check=True)
    with out.open(encoding="utf-8") as lines:
        return [{name: float(text) for name, text in row.items()} for row in csv.DictReader(lines)]


def as_printed(values: Any) -> list[float]:
    """Return numbers with the 16 digits that fmusim prints."""
    return [float(f"{value:.16g}") for value in values]


@with_fmusim
@pytest.mark.parametrize(("version", "words"), [(2, ()), (3, ()), (3, ("--early-return-allowed", "--event-mode-used"))])
def test_fmusim_reads_every_number_and_impact_of_a_run(unit: Any, version: int, words: tuple[str, ...]) -> None:
    run = mt.rollout("impact_mass", STEP_S * STEPS)
    names = [name for name in COLUMNS if name in run.columns]
    rows = in_fmusim(unit("impact_mass", version), [*names, "event.impact.time_s"], "--stop-time", "0.6", *words)
    last = {round(row["time"] / STEP_S): row for row in rows}  # one of event mode stands there twice
    assert sorted(last) == list(range(STEPS + 1))
    assert [last[step]["event.impact.time_s"] for step in range(1, STEPS + 1)] == as_printed(impacts(run))
    for name in names:
        assert [last[step][name] for step in range(STEPS + 1)] == as_printed(run[name]), name


@with_fmusim
@pytest.mark.parametrize("version", [2, 3])
def test_fmusim_goes_on_from_a_state_in_a_file(unit: Any, version: int, tmp_path: Path) -> None:
    file, state = unit("impact_mass", version), str(tmp_path / "state")
    in_fmusim(file, COLUMNS[:2], "--stop-time", "0.25", "--final-fmu-state-file", state)
    begun = ("--start-time", "0.25", "--stop-time", "0.6", "--initial-fmu-state-file", state)
    onward = in_fmusim(file, COLUMNS[:2], *begun)
    run = mt.rollout("impact_mass", 0.6)
    for name in COLUMNS[:2]:
        assert [row[name] for row in onward] == as_printed(run[name][250:]), name
