# SPDX-License-Identifier: Apache-2.0
"""How identification does on runs of machines it has never seen: hidden keys, zeros and lags, no noise told.

    python benchmarks/identification/hidden_draws.py [MACHINE]... [--draws N] [--minutes M] [--journal FILE] [--write]

The runs are made by `independent_machines.py` and `independent_driven_machines.py` of test/studies/identification,
which write each machine a second time; that of the breaker takes the product's parameters and judge.  Every key is off
by up to a half of itself.
``--write`` puts a row a machine into docs/proof/hidden-draws.md; ``--journal`` keeps finished draws, so that a run that
was ended goes on.  Ends with exit code 1 where fewer than 95 % of what is called identified lie inside, or over 2 % are
off by over 3 standard errors.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(1, str(Path(__file__).resolve().parents[2] / "test"))
from evidence import share_interval, write_rows
from studies.identification.independent_driven_machines import DRIVEN_BENCHES
from studies.identification.independent_machines import BENCHES, Bench, HiddenDraw, hidden_draw

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.runs import read_run
from mech_twin.measurements.tables import TableReader
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.identification.fit_runs import fit_run
from mech_twin.studies.identification.identification import identified
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.identification.sensor_plan import sensor_plan
from mech_twin.studies.spreading import spread

EVERY = {**BENCHES, **DRIVEN_BENCHES}
PAGE = Path(__file__).resolve().parents[2] / "docs" / "proof" / "hidden-draws.md"
HEADS = (
    *("machine", "draws", "keys", "identified", "inside 95 %", "of them, %", "95 % of it", "wrong (3 s.e.)"),
    *(
        "planned",
        "of them found, %",
        "not converged",
        "model error",
        "no answer",
        "off by over 5 %",
        "processor, s",
        "longest, s",
    ),
)
FAR_OFF = 0.05  # of the true value
HOLD_OUT = 0.2


@dataclass(frozen=True)
class Drawn:
    """What was found of one hidden draw; the seconds are those of the processor.

    ``combinations`` are those stated for ranges that hold the true values of their fixed keys.
    """

    seed: int
    keys: tuple[dict[str, float | str], ...]
    planned: tuple[str, ...]
    seconds: float
    combinations: tuple[dict[str, float | str], ...] = ()


def found_of(label: str, seed: int, planning: bool = True) -> Drawn:
    """Return what is found of one draw."""
    bench = EVERY[label]
    draw = hidden_draw(bench, seed)
    given = MeasurementMap.model_validate(draw.map_tree())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        draw.write(path)
        run = fit_run(read_run(TableReader(path), given), begin_known=True)
    base = machine_parameters(bench.machine, None, bench.settings)
    question = IdentificationQuestion(bench.machine, base, bench.keys, cores=1)
    promised = planned(bench, draw) if planning else ()
    began = time.process_time()
    try:
        found = identified(question, [run], (), HOLD_OUT)
    except ConfigurationError:  # the command ends with one line and no answer
        return Drawn(seed, (), promised, time.process_time() - began)
    seconds = time.process_time() - began
    keys = [{**_told(key), "true": draw.true[key.key]} for key in found.keys]
    stated = tuple(
        {"formula": each.formula, "low_95": each.low_95, "high_95": each.high_95, "true": each.of(draw.true)}
        for each in found.combinations
        if each.applies(draw.true)
    )
    return Drawn(seed, tuple(keys), promised, seconds, stated)


def _told(key: object) -> dict[str, float | str]:
    return {name: value if isinstance(value, str) else float(value) for name, value in asdict(key).items()}  # type: ignore[call-overload]


def planned(bench: Bench, draw: HiddenDraw) -> tuple[str, ...]:
    """Return the keys that a plan with these sensors calls identified at the true values."""
    base = machine_parameters(bench.machine, None, {**bench.settings, **draw.true})
    question = IdentificationQuestion(bench.machine, base, bench.keys, cores=1)
    tree = draw.map_tree()
    opened = MeasurementMap.model_validate(tree)
    for channel, sensor in zip(tree["channels"], bench.sensors, strict=True):
        channel |= {"rate_hz": sensor.rate_hz, "sigma": sensor.sigma, "zero": 0.0, "lag_s": 0.0}
    sensors = MeasurementMap.model_validate(tree)
    plan = sensor_plan(question, sensors, (1.0 - HOLD_OUT) * bench.duration_s, opened, helps=False)
    return tuple(key.key for key in plan.keys if key.verdict == "identified")


def draws_of(machine: str, asked: argparse.Namespace) -> Iterator[Drawn]:
    """Yield the draws of a machine, those of the journal first, the others until the time is over."""
    until = time.monotonic() + 60.0 * asked.minutes
    known = {drawn.seed: drawn for name, drawn in _kept(asked.journal) if name == machine and drawn.seed < asked.draws}
    yield from known.values()
    left = [seed for seed in range(asked.draws) if seed not in known]
    with closing(spread(partial(found_of, machine), left, asked.cores, None)) as results:
        for result in results:
            if asked.journal is not None:
                with asked.journal.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps({"machine": machine, **asdict(result)}) + "\n")
            yield result
            if time.monotonic() > until:
                return


def _kept(journal: Path | None) -> Iterator[tuple[str, Drawn]]:
    if journal is None or not journal.exists():
        return
    for line in journal.read_text(encoding="utf-8").splitlines(keepends=True):
        if line.endswith("\n"):
            tree = json.loads(line)
            yield tree.pop("machine"), Drawn(**{**tree, "keys": tuple(tree["keys"]), "planned": tuple(tree["planned"])})


def is_inside(key: dict[str, float | str]) -> bool:
    """Return whether the interval of a key, or of a combination, holds the truth."""
    return bool(float(key["low_95"]) <= float(key["true"]) <= float(key["high_95"]))


def is_wrong(key: dict[str, float | str]) -> bool:
    """Return whether a key is off by more than three standard errors, and outside its interval."""
    off = abs(float(key["estimate"]) - float(key["true"]))
    return bool(off > 3.0 * float(key["standard_error"])) and not is_inside(key)


def row_of(machine: str, drawn: list[Drawn]) -> tuple[object, ...]:
    """Return the row of a machine."""
    told = [key for each in drawn for key in each.keys if key["verdict"] == "identified"]
    inside, wrong = sum(map(is_inside, told)), sum(map(is_wrong, told))
    low, high = share_interval(inside, len(told)) if told else (0.0, 100.0)
    promised = sum(len(each.planned) for each in drawn)
    kept = sum(key["key"] in each.planned and key["verdict"] == "identified" for each in drawn for key in each.keys)
    of = {
        word: sum(any(key["verdict"] == word for key in each.keys) for each in drawn)
        for word in ("not_converged", "model_error")
    }
    far = [abs(float(key["estimate"]) / float(key["true"]) - 1.0) > FAR_OFF for each in drawn for key in each.keys]
    seconds = [each.seconds for each in drawn]
    return (
        *(machine, len(drawn), len(far), len(told), inside, f"{100.0 * inside / max(len(told), 1):.1f}"),
        *(f"{low:.1f} to {high:.1f}", wrong, promised, f"{100.0 * kept / max(promised, 1):.1f}"),
        *(
            of["not_converged"],
            of["model_error"],
            sum(not each.keys for each in drawn),
            sum(far),
            f"{np.median(seconds):.1f}",
            f"{max(seconds):.1f}",
        ),
    )


def main() -> None:
    words = argparse.ArgumentParser()
    words.add_argument("machines", nargs="*", default=list(EVERY))
    words.add_argument("--draws", type=int, default=40)
    words.add_argument("--minutes", type=float, default=1e6, help="after them no further draw of a machine is begun")
    words.add_argument("--journal", type=Path)
    words.add_argument("--cores", type=int, default=1, help="processes, one draw each")
    words.add_argument("--as", dest="label", default="", help="word behind the machine's name in the table")
    words.add_argument("--write", action="store_true", help="into docs/proof/hidden-draws.md")
    asked = words.parse_args()
    kept = True
    for machine in asked.machines:
        drawn = []
        for each in draws_of(machine, asked):
            drawn.append(each)
            verdicts = ", ".join(
                f"{key['key']} {float(key['estimate']) / float(key['true']):.4f} {key['verdict']}"
                + (" OUT" if key["verdict"] == "identified" and not is_inside(key) else "")
                for key in each.keys
            )
            print(f"{machine} {each.seed}: {each.seconds:.1f} s; {verdicts}", flush=True)
        stated = [is_inside(one) for each in drawn for one in each.combinations]
        print(f"combinations: {len(stated)}, inside 95 %: {sum(stated)}", flush=True)
        row = row_of(f"{machine}{f', {asked.label}' if asked.label else ''}", drawn)
        print(*(f"{head}: {cell};" for head, cell in zip(HEADS, row, strict=True)), flush=True)
        told, inside, wrong = (int(str(row[i])) for i in (3, 4, 7))
        kept &= inside >= 0.95 * told and wrong <= 0.02 * told
        if asked.write:
            write_rows("hidden_draws", HEADS, [row], PAGE)
    sys.exit(int(not kept))


if __name__ == "__main__":
    main()
