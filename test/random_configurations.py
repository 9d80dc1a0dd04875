# SPDX-License-Identifier: Apache-2.0
"""Many random legal configurations of a machine, and what each must keep: the long form of a test.

python test/random_configurations.py MACHINE COUNT [--seed SEED]     goes on where it was ended
python test/random_configurations.py MACHINE --only NUMBER           one of them again, in this process
python test/random_configurations.py --table                         writes the table of docs/random-configurations.md

Each configuration is analysed at several crank angles and simulated for half a second, in half of them with the drive
switched off and on again.  Every number must be finite and every residual within its limit; each value that is refused
on the way must be refused in one line that names a key and a number.  What breaks is printed as a parameter file.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import sys
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple, get_args

from configuration_draws import Draw, Refused, leaves

from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_events, frame_numbers
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import description_text
from mech_twin.roles import Machine
from mech_twin.samples import Frame

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "random-configurations.md"
KEPT = ROOT / "build" / "random_configurations"
RUN_S = 0.5
LONGEST_S = 1200.0  # of one configuration, in real time, beside other work: more counts as endless
ANGLES_RAD = (0.0, 1.0, math.pi, 5.5)
BEGIN, END = "<!-- written by test/random_configurations.py -->", "<!-- end -->"


class Outcome(NamedTuple):
    """What became of one draw: empty ``broken`` where all held; ``margin`` is the worst residual over its limit."""

    number: int
    broken: str
    margin: float
    refused: int
    seconds: float
    text: str


def numbers_in(tree: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield every float of nested groups and lists, with its name."""
    if isinstance(tree, dict):
        for key, value in tree.items():
            yield from numbers_in(value, f"{name}.{key}")
    elif isinstance(tree, list | tuple):
        for value in tree:
            yield from numbers_in(value, name)
    elif isinstance(tree, float):
        yield name, tree


def bad_refusal(name: str, refused: Refused) -> str:
    """Return what is wrong with a refusal: it must be one line with a key of the model, and a number or an option."""
    options = {str(word) for leaf in leaves(CATALOGUE[name].parameters) for word in get_args(leaf.kinds[0])}
    keys = {leaf.path[-1] for leaf in leaves(CATALOGUE[name].parameters)} | set(refused.key.split("."))
    text = refused.message.removeprefix("draw")
    expected = any(letter.isdigit() for letter in text) or any(option in text for option in options)
    good = "\n" not in text and any(key in text for key in keys) and expected
    return "" if good else f"refusal of {refused.key} = {refused.value}: {refused.message}"


def worst_margin(machine: Machine, frame: Frame) -> tuple[float, str]:
    """Return the largest residual of a frame over its limit, nan counting as infinite, and its name."""
    worst, which = 0.0, ""
    roles = ((machine.linkage, frame.linkage), (machine.forces, frame.forces), (machine.body, frame.body))
    for role, sample in roles:
        if role is None or sample is None:
            continue
        for residual, value in sample.residuals.as_dict().items():
            margin = abs(value) / role.residual_limits[residual]
            if not margin <= worst:
                worst, which = math.inf if math.isnan(margin) else margin, f"{residual} {value:.3g}"
    return worst, which


def run(machine: Machine, commands: tuple[float, ...], run_s: float = RUN_S) -> tuple[str, float]:
    """Return what a run and the analyses break first, or nothing, and the worst residual over its limit."""
    analyses = {"report": machine.report(), "analyse": [machine.analyse(angle) for angle in ANGLES_RAD]}
    for name, value in numbers_in(analyses):
        if not math.isfinite(value):
            return f"{name} = {value}", 0.0
    observer, steps, worst = machine.observer(), round(run_s / machine.coupling_step_s), 0.0
    for frame in frames(machine, run_s, lambda step: commands[step * len(commands) // (steps + 1)]):
        observer.observe(frame)
        at = f"at {frame.linkage.time_s:g} s"
        for name, value in frame_numbers(frame):
            if not math.isfinite(value):
                return f"{name} = {value} {at}", worst
        for event in frame_events(frame):
            if not math.isfinite(event.time_s + event.impulse_ns):
                return f"{event.kind} is not finite {at}", worst
        margin, which = worst_margin(machine, frame)
        worst = max(worst, margin)
        if margin > 1.0:
            return f"{which} {at}", worst
    for name, value in numbers_in(observer.numbers()):
        if not math.isfinite(value):
            return f"metrics: {name} = {value}", worst
    return "", worst


def outcome_of(name: str, seed: int, number: int) -> Outcome:
    """Return what became of one draw."""
    begun, text, refused, margin = time.perf_counter(), "", 0, 0.0
    try:
        draw = Draw(name, seed, number)
        refused = len(draw.refused)
        text = f"# drive: {draw.commands}\n" + description_text(name, draw.parameters)
        found = next(filter(None, (bad_refusal(name, one) for one in draw.refused)), "")
        if not found:
            found, margin = run(CATALOGUE[name].build(draw.parameters), draw.commands)
    except Exception as error:  # noqa: BLE001 - what a legal input must never end in
        found = f"{type(error).__name__}: {error}"
    return Outcome(number, found, margin, refused, time.perf_counter() - begun, text)


def _serve(name: str, seed: int, pipe: Connection) -> None:
    while (number := pipe.recv()) is not None:
        pipe.send(outcome_of(name, seed, number))


class Worker:
    """A process that takes one draw at a time, and is ended where one does not come back."""

    def __init__(self, name: str, seed: int) -> None:
        self.pipe, other = multiprocessing.Pipe()
        context = multiprocessing.get_context("spawn")
        self.process = context.Process(target=_serve, args=(name, seed, other), daemon=True)
        self.process.start()
        other.close()

    def outcome(self, number: int) -> Outcome:
        """Return what became of a draw."""
        self.pipe.send(number)
        try:
            if self.pipe.poll(LONGEST_S):
                answer: Outcome = self.pipe.recv()
                return answer
            found = f"does not end within {LONGEST_S:g} s"
        except EOFError:
            found = "ended the process"
        self.process.kill()
        self.process.join()
        return Outcome(number, found, 0.0, 0, LONGEST_S, "")


def say(text: str) -> None:
    """Write a line at once."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def kept_outcomes(name: str, seed: int) -> list[dict[str, Any]]:
    """Return what is known of a machine's draws."""
    file = KEPT / f"{name}_{seed}.jsonl"
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def long_form(name: str, count: int, seed: int) -> int:
    """Try what of so many draws has not been tried; print what breaks, and return how many do."""
    KEPT.mkdir(parents=True, exist_ok=True)
    done = {outcome["number"] for outcome in kept_outcomes(name, seed)}
    worker = Worker(name, seed)
    with (KEPT / f"{name}_{seed}.jsonl").open("a") as log:
        for number in range(count):
            if number in done:
                continue
            outcome = worker.outcome(number)
            if not worker.process.is_alive():
                worker = Worker(name, seed)
            kept = outcome._asdict() | {"date": f"{datetime.now(UTC):%Y-%m-%d}"}
            log.write(json.dumps(kept | ({} if outcome.broken else {"text": ""})) + "\n")
            log.flush()
            if outcome.broken:
                say(f"# {name} {seed}/{number}: {outcome.broken}\n{outcome.text}")
    return sum(bool(outcome["broken"]) for outcome in kept_outcomes(name, seed))


def table_lines() -> Iterator[str]:
    """Yield the table of all that was kept."""
    yield "| machine | legal configurations | seed | values refused in one line on the way "
    yield "| worst residual over its limit | slowest | broken | date |\n|---|---|---|---|---|---|---|---|\n"
    for name in CATALOGUE:
        for file in sorted(KEPT.glob(f"{name}_*.jsonl")):
            seed = file.stem.rpartition("_")[2]
            kept = kept_outcomes(name, int(seed))
            if not kept:
                continue
            refused, broken = sum(k["refused"] for k in kept), sum(bool(k["broken"]) for k in kept)
            margin, slowest = max(k["margin"] for k in kept), max(k["seconds"] for k in kept)
            yield f"| {name} | {len(kept)} | {seed} | {refused} | {margin:.2g} | {slowest:.1f} s | {broken} "
            yield f"| {max(k['date'] for k in kept)} |\n"


def write_table() -> None:
    """Write the table into its page."""
    head, _, rest = PAGE.read_text().partition(BEGIN)
    PAGE.write_text(head + BEGIN + "\n" + "".join(table_lines()) + END + rest.partition(END)[2])


def main() -> int:
    """Run the long form, one draw, or write the table."""
    asked = argparse.ArgumentParser(description="random legal configurations of a machine")
    asked.add_argument("machine", nargs="?", choices=list(CATALOGUE))
    asked.add_argument("count", nargs="?", type=int, default=0)
    asked.add_argument("--seed", type=int, default=1)
    asked.add_argument("--only", type=int)
    asked.add_argument("--table", action="store_true")
    given = asked.parse_args()
    if given.table:
        write_table()
        return 0
    if given.only is not None:
        outcome = outcome_of(given.machine, given.seed, given.only)
        say(f"{outcome.text}{outcome._replace(text='')}")
        return int(bool(outcome.broken))
    return int(long_form(given.machine, given.count, given.seed) > 0)


if __name__ == "__main__":
    sys.exit(main())
