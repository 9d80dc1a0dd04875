# SPDX-License-Identifier: Apache-2.0
"""A fleet of machines, a week each, told by ``mech-twin fleet``: what is found, missed and false.

    python benchmarks/monitoring/fleet.py FOLDER [--machine NAME] [--machines 200] [--write]

Each machine has numbers of its own within a tolerance.  A week is sampled by windows, as a logger does: eight on the
first day, then two a day, each at an operating point that is drawn and through fresh noise.  Seven machines hide a
fault from a day on that is drawn.  The sensors are those of the monitor's proof.  Machines that FOLDER holds already
are told again.  Results stand in results/MACHINE.fleet.json, the table in docs/proof/monitoring.md.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from plants import SENSORS, monitored_machine, wander
from proof import RESULTS

from mech_twin.capabilities.faults import value_at
from mech_twin.capabilities.variation import varied
from mech_twin.engine.rollout import roll_out
from mech_twin.files.output_file import written_file
from mech_twin.studies.monitoring.operating_fit import parameters_at
from mech_twin.studies.monitoring.sensing import MonitoredMachine, needed_columns, seen_roll_out
from mech_twin.studies.spreading import available_cores, spread

PAGE = Path(__file__).parents[2] / "docs" / "proof" / "monitoring.md"
MARKS = "<!-- fleet begins -->", "<!-- fleet ends -->"
WINDOW_S, FIRST_DAY, DAYS, HOURS = 12.0, 8, 7, (6, 18)
FAULTY = 7
SUSPECT = "confirmed", "apart"
TOLERANCE = 0.01  # standard deviation of the numbers that faults change, as a share
RANGE = 0.5  # of the range of each operating variable


def drawn_machine(name: str, seed: int) -> MonitoredMachine:
    """Return a machine with numbers of its own."""
    found, random = monitored_machine(name), np.random.default_rng([seed, 1])
    keys = sorted({fault.key for fault in found.faults if fault.key})
    drawn = {key: value_at(found.parameters, key) for key in keys}
    own = {key: value * (1.0 + TOLERANCE * random.standard_normal()) for key, value in drawn.items() if value}
    return MonitoredMachine(name, varied(found.parameters, own), found.sensors)


def recording(
    machine: MonitoredMachine, duration_s: float, random: np.random.Generator, fault: tuple[str, float] | None
) -> pd.DataFrame:
    """Return what the sensors show at an operating point that is drawn, with a fault or none."""
    shares = [RANGE * variable.range * random.uniform(-1.0, 1.0) for variable in machine.operating]
    parameters = parameters_at(machine.parameters, machine.operating, shares)
    assert parameters is not None
    if fault is not None:
        (kind,) = [each for each in machine.faults if each.name == fault[0]]
        parameters = varied(parameters, kind.changes(parameters, fault[1]))
    built, begin_s = machine.entry.build(parameters), machine.declared.run_up_s
    steps = round((begin_s + duration_s) / built.coupling_step_s)
    command = np.minimum(wander(steps, built.coupling_step_s, random), 1.0)
    run = roll_out(built, steps * built.coupling_step_s, needed_columns(machine.sensors), None, command)
    if run.error is not None:
        raise run.error
    seen = seen_roll_out(run, machine.sensors, built.coupling_step_s, random, begin_s)
    times_s = next(iter(seen.values()))[0]
    assert all(np.array_equal(times_s, each[0]) for each in seen.values())
    return pd.DataFrame({"time_s": times_s - begin_s, **{column: each[1] for column, each in seen.items()}})


def hidden(name: str, machines: int) -> dict[int, tuple[str, float, int]]:
    """Return fault, size and day of those that hide one."""
    random, faults = np.random.default_rng(7), monitored_machine(name).faults
    numbers = random.choice(machines, FAULTY, replace=False).tolist()
    kinds = random.permutation(len(faults))[:FAULTY].tolist()
    return {
        number: (faults[kind].name, float(random.choice(faults[kind].sizes)), int(random.integers(2, DAYS)))
        for number, kind in zip(numbers, (kinds * FAULTY)[:FAULTY], strict=True)
    }


def write_machine(name: str, folder: Path, secret: dict[int, tuple[str, float, int]], number: int) -> int:
    """Write a machine's week as Parquet files; return its number."""
    own, unfinished = folder / f"{name}_{number:03d}", folder.parent / f"{folder.name}.unfinished" / str(number)
    if own.exists():
        return number
    unfinished.mkdir(parents=True, exist_ok=True)
    machine, random, fault = drawn_machine(name, number), np.random.default_rng([number, 2]), secret.get(number)
    windows = [(0, window) for window in range(FIRST_DAY)]
    windows += [(day, hour) for day in range(1, DAYS + 1) for hour in HOURS]
    for day, hour in windows:
        told = fault[:2] if fault is not None and day >= fault[2] else None
        recording(machine, WINDOW_S, random, told).to_parquet(unfinished / f"day_{day}_{hour:02d}h.parquet")
    folder.mkdir(parents=True, exist_ok=True)
    unfinished.rename(own)
    return number


def write_map(name: str, folder: Path) -> Path:
    """Write the map of the recordings."""
    told = yaml.safe_load((SENSORS / f"{name}.yaml").read_text(encoding="utf-8"))
    rows = [{**row, "source": {"column": row["is"]}} for row in told["channels"]]
    file = folder.parent / f"{folder.name}.map.yaml"
    tree = {"machine": name, "time": {"column": "time_s", "unit": "s"}, "channels": rows}
    file.write_text(yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")
    return file


def told_fleet(name: str, folder: Path, machines: int) -> dict[str, Any]:
    """Return what the verb tells of the fleet beside what is hidden in it."""
    secret, words = hidden(name, machines), ["-c", "from mech_twin.cli.main import main; main()"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    settings = [f"--set={key}={value}" for key, value in _settings(name).items()]
    asked = [
        "fleet",
        name,
        str(folder),
        "--map",
        str(write_map(name, folder)),
        "--json",
        "--skip",
        "0",
        "--healthy",
        str(FIRST_DAY),
    ]
    asked += ["--cores", str(available_cores()), *settings]
    done = subprocess.run([sys.executable, *words, *asked], stdout=subprocess.PIPE, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found = json.loads(done.stdout)
    suspects = {each["name"]: each for each in found["machines"] if each["verdict"]}
    rows = []
    for number, (fault, size, day) in secret.items():
        one = suspects.pop(f"{name}_{number:03d}", None)
        candidate = (one or {}).get("candidate") or {}
        told = {"found_size": candidate.get("size"), "apart": (one or {}).get("apart")}
        told |= {key: (one or {}).get(key, "") for key in ("finding", "recording", "verdict")}
        rows.append({"fault": fault, "size": size, "day": day, **told})
    false = [{key: each[key] for key in ("finding", "apart", "verdict")} for each in suspects.values()]
    cycles = sum(each["cycles"] for each in found["machines"])
    return {"machine": name, "machines": machines, "cycles": cycles, "spent_s": spent_s,
            "hidden": rows, "false": false, "refused": found["refused"]}  # fmt: skip


def _settings(name: str) -> dict[str, Any]:
    from plants import SETTINGS

    return SETTINGS.get(name, {})


def table() -> str:
    """Return the tables of all results."""
    lines = []
    for path in sorted(RESULTS.glob("*.fleet.json")):
        told = json.loads(path.read_text(encoding="utf-8"))
        found = sum(row["verdict"] in SUSPECT for row in told["hidden"])
        false = sum(row["verdict"] in SUSPECT for row in told["false"])
        counts = f"{told['machines']} machines, {told['cycles']} cycles, {told['spent_s']:.0f} s of processor time"
        missed, unconfirmed = len(told["hidden"]) - found, len(told["false"]) - false
        lines += [
            f"`{told['machine']}`: {counts}. {found} of {len(told['hidden'])} found, "
            f"{missed} missed, {false} false, {len(told['refused'])} not judged; "
            f"{unconfirmed} healthy ones have an unconfirmed finding.",
            "",
            "| hidden | size | from day | verdict | told as | size told | in recording | apart from sisters |",
            "|---|---|---|---|---|---|---|---|",
        ]
        for row in told["hidden"]:
            size = "" if row["found_size"] is None else f"{row['found_size']:.3g}"
            apart = "" if row["apart"] is None else f"{row['apart']:+.1f}"
            name = (row["verdict"] or "missed", row["finding"])
            cells = (row["fault"], f"{row['size']:g}", row["day"], *name, size, Path(row["recording"]).stem, apart)
            lines.append(f"| {' | '.join(map(str, cells))} |")
        listed = [f"{row['finding'] or 'no finding'} ({row['apart']:+.1f}, {row['verdict']})" for row in told["false"]]
        lines += ["", f"Of healthy machines: {'; '.join(listed)}." if listed else "", ""]
    return "\n".join(lines).rstrip()


def main() -> None:
    """Make a fleet and tell it, or write the table."""
    parser = argparse.ArgumentParser(description="a fleet told by `mech-twin fleet`")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--machine", default="vibration_crank")
    parser.add_argument("--machines", type=int, default=200)
    parser.add_argument("--write", action="store_true", help="write the table into the page")
    asked = parser.parse_args()
    folder = asked.folder / asked.machine
    one = partial(write_machine, asked.machine, folder, hidden(asked.machine, asked.machines))
    for number in spread(one, range(asked.machines), available_cores()):
        print(f"\rmachine {number}", end="", file=sys.stderr)
    told = told_fleet(asked.machine, folder, asked.machines)
    print(json.dumps(told, indent=1))
    RESULTS.mkdir(exist_ok=True)
    with written_file(RESULTS / f"{asked.machine}.fleet.json", force=True) as file:
        file.write_text(json.dumps(told) + "\n", encoding="utf-8")
    if asked.write:
        begin, end = map(re.escape, MARKS)
        text = PAGE.read_text(encoding="utf-8")
        new = re.sub(f"(?s){begin}.*{end}", lambda _: f"{MARKS[0]}\n{table()}\n{MARKS[1]}", text)
        PAGE.write_text(new, encoding="utf-8")


if __name__ == "__main__":
    main()
