# SPDX-License-Identifier: Apache-2.0
"""``mech-twin identify MACHINE --plan``: which keys given sensors would find, and what would help most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from mech_twin.cli.console import print_json, print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.parameters.load import catalogue_entry, kind_of
from mech_twin.results.opened_runs import given_map
from mech_twin.studies.identification.combinations import Combination
from mech_twin.studies.identification.question import IdentificationQuestion
from mech_twin.studies.identification.sensor_plan import sensor_plan

MOST_SHOWN = 12


def show_combinations(told: Sequence[Combination]) -> None:
    """Print what is seen of keys that are not seen alone, and for which values of held keys that is so."""
    heads = ("combination", "estimate", "95 % from", "to", "holds for")
    rows = [(each.formula, each.estimate, each.low_95, each.high_95, each.condition) for each in told]
    print_table("seen in combination", heads, rows)


def show_plan(
    question: IdentificationQuestion, sensors_file: Path, map_file: Path | None, duration_s: float, *, as_json: bool
) -> None:
    """Print what the sensors of a file would find in a run of this length."""
    built = catalogue_entry(question.machine).build(question.base)
    sensors = given_map(sensors_file, built)
    opened = None if map_file is None else given_map(map_file, built)
    kind = kind_of(question.machine)
    for given, file in ((sensors, sensors_file), (opened, map_file)):
        if given is not None and given.machine != kind:
            raise CommandError(f"{file}: key 'machine', value {given.machine!r}: expected {kind!r}")
    names = [channel.quantity for channel in sensors.channels]
    if opened is not None and [channel.quantity for channel in opened.channels] != names:
        raise CommandError(f"{map_file}: expected the channels of {sensors_file}, in their order")
    plan = sensor_plan(question, sensors, duration_s, opened)
    if as_json:
        helps = [asdict(each) for each in plan.helps]
        keys = [asdict(key) for key in plan.keys]
        combined = [asdict(each) for each in plan.combinations]
        print_json({"machine": question.machine, "parameters": keys, "combinations": combined, "helps": helps})
        return
    rows = [(k.key, k.estimate, 0.5 * (k.high_95 - k.low_95), k.verdict) for k in plan.keys]
    print_table(f"{question.machine}: {duration_s:g} s", ("key", "value", "+- (95 %)", "verdict"), rows)
    for key in plan.keys:
        if key.verdict != "identified":
            say(f"{key.key}: {key.verdict}, {key.reason}")
    if plan.combinations:
        show_combinations(plan.combinations)
    helped = [(h.what, ", ".join(h.identified) or "-", h.narrowed) for h in plan.helps[:MOST_SHOWN]]
    print_table("what would help most", ("sensor or manoeuvre", "would also find", "intervals narrower by"), helped)
