# SPDX-License-Identifier: Apache-2.0
"""How often the 95 % intervals hold the truth: seeded repeats of a synthetic measurement, each identified anew.

    python benchmarks/identification/interval_coverage.py STAND [--repeats N] [--first SEED] [--minutes M]
                                                          [--journal FILE] [--write]

A row a stand: how often each key was called identified and its interval then held the truth, its median half width over
that which ``--plan`` foretells, and the shares of all keys and combinations with their 95 % intervals; and every key
that was called identified though it cannot be.  After M minutes no further repeat is begun.
``--journal`` keeps every finished repeat, so that a run which was ended goes on where it stopped.  ``--scheduler``
spreads the repeats over a Dask cluster.  Ends with exit code 1 where a key that cannot be told was called identified.
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
from evidence import share_interval, write_rows
from synthetic_stand import SHORT_STANDS, STANDS, Stand

from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.identification.identification import identified
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.identification.sensor_plan import sensor_plan
from mech_twin.studies.identification.verdicts import KeyVerdict
from mech_twin.studies.spreading import spread

HEADS = ("stand", "repeats", "held of identified (half width over plan's)", "all keys", "combinations")


@dataclass(frozen=True)
class Repeat:
    """One measurement and what was found of it."""

    seed: int
    keys: tuple[KeyVerdict, ...]
    combinations: int
    combinations_held: int
    combinations_beyond: int  # told of other values of held keys than the true ones alone: they say nothing here
    seconds: float


def question_of(stand: Stand, cores: int | None = 1) -> IdentificationQuestion:
    """Return what is asked of a stand's runs."""
    return IdentificationQuestion(stand.name, machine_parameters(stand.name), stand.keys, cores=cores)


def stand_of(name: str, *, whole: bool) -> Stand:
    """Return the stand whose measurements are repeated: a short run of few open keys, or the whole one."""
    return (STANDS if whole else SHORT_STANDS)[name]


def repeated(name: str, whole: bool, seed: int) -> Repeat:
    """Return one repeat."""
    stand = stand_of(name, whole=whole)
    began, true = time.process_time(), stand.truth()
    with tempfile.TemporaryDirectory() as folder:
        run = stand.run(Path(folder), seed)
    found = identified(question_of(stand), [run])
    said = [each for each in found.combinations if each.applies(true)]
    held = sum(each.low_95 <= each.of(true) <= each.high_95 for each in said)
    beyond = len(found.combinations) - len(said)
    return Repeat(seed, found.keys, len(said), held, beyond, time.process_time() - began)


def repeats_of(asked: argparse.Namespace) -> Iterator[Repeat]:
    """Yield repeats, those of the journal first, the others as they are ready until the time is over."""
    until = time.monotonic() + 60.0 * asked.minutes
    seeds = range(asked.first, asked.first + asked.repeats)
    known = {each.seed: each for each in _kept(asked.journal) if each.seed in seeds}
    yield from known.values()
    left = [seed for seed in seeds if seed not in known]
    one = partial(repeated, asked.machine, asked.whole)
    with closing(spread(one, left, asked.cores, asked.scheduler)) as results:
        for result in results:
            if asked.journal is not None:
                with asked.journal.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(asdict(result)) + "\n")
            yield result
            if time.monotonic() > until:
                return


def _kept(journal: Path | None) -> Iterator[Repeat]:
    """Yield the repeats of a journal; a last line that was cut off is none."""
    if journal is None or not journal.exists():
        return
    for line in journal.read_text(encoding="utf-8").splitlines(keepends=True):
        if line.endswith("\n"):
            tree = json.loads(line)
            yield Repeat(**{**tree, "keys": tuple(KeyVerdict(**key) for key in tree["keys"])})


def planned(stand: Stand) -> dict[str, float]:
    """Return the half widths that a plan foretells of the stand's keys at their true values."""
    question = IdentificationQuestion(stand.name, machine_parameters(stand.name, None, stand.true), stand.keys, cores=1)
    sensors, opened = stand.maps()
    keys = sensor_plan(question, sensors, stand.duration_s, opened, helps=False).keys
    return {key.key: 0.5 * (key.high_95 - key.low_95) for key in keys if key.verdict == "identified"}


def row_of(stand: Stand, repeats: list[Repeat], plan: dict[str, float]) -> tuple[object, ...]:
    """Return the table's row: every key, all keys together, and the combinations."""
    true, every, every_held, keys = stand.truth(), 0, 0, []
    for key in stand.keys:
        told = [v for each in repeats for v in each.keys if v.key == key and v.verdict == "identified"]
        held = sum(v.low_95 <= true[key] <= v.high_95 for v in told)
        every, every_held = every + len(told), every_held + held
        halves = [0.5 * (v.high_95 - v.low_95) for v in told]
        over = f" ({np.median(halves) / plan[key]:.2f})" if told and key in plan else ""
        keys.append(f"{key} {held} of {len(told)}{over}")
    told_products = sum(each.combinations for each in repeats)
    held_products = sum(each.combinations_held for each in repeats)
    beyond = sum(each.combinations_beyond for each in repeats)
    rest = f"; {beyond} of other held values" if beyond else ""
    name = f"{stand.name}, {stand.duration_s:g} s"
    return (name, len(repeats), ", ".join(keys), _share(every_held, every), _share(held_products, told_products) + rest)


def _share(held: int, told: int) -> str:
    if not told:
        return "none"
    low, high = share_interval(held, told)
    return f"{held} of {told}: {100.0 * held / told:.1f} % ({low:.1f} to {high:.1f})"


def main() -> None:
    words = argparse.ArgumentParser()
    words.add_argument("machine", choices=list(STANDS))
    words.add_argument("--repeats", type=int, default=200)
    words.add_argument("--first", type=int, default=0)
    words.add_argument("--minutes", type=float, default=1e6)
    words.add_argument("--whole", action="store_true", help="the stand of the grid, not its short run of few keys")
    words.add_argument("--journal", type=Path, help="where finished repeats are kept")
    words.add_argument("--cores", type=int, default=1, help="processes, one repeat each")
    words.add_argument("--scheduler", help="address of a Dask scheduler in their place")
    words.add_argument("--write", action="store_true", help="into docs/proof/identification.md")
    asked = words.parse_args()
    stand, repeats, wrong = stand_of(asked.machine, whole=asked.whole), [], []
    for each in repeats_of(asked):
        repeats.append(each)
        wrong += [(each.seed, v) for v in each.keys if v.verdict == "identified" and v.key in stand.never]
        told = [v for v in each.keys if v.verdict == "identified"]
        out = [v.key for v in told if not v.low_95 <= stand.truth()[v.key] <= v.high_95]
        products = f"{each.combinations_held} of {each.combinations} combinations hold"
        print(f"seed {each.seed}: {each.seconds:.1f} s, {len(told)} identified, outside: {out}; {products}", flush=True)
    row = row_of(stand, repeats, planned(stand))
    print(*HEADS, sep="; ")
    print(*row, sep="; ")
    print("wrongly identified:", wrong or "none")
    if asked.write:
        write_rows("interval_coverage", HEADS, [row])
    sys.exit(int(bool(wrong)))


if __name__ == "__main__":
    main()
