# SPDX-License-Identifier: Apache-2.0
"""Answers of ``mech-twin study MACHINE synthesise`` and ``regimes``."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from mech_twin.cli.console import print_csv, print_json, print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.study_options import axes_of, counted, notes_of, study_errors, told
from mech_twin.cli.study_report import Studied, check_report, report_regimes, report_synthesis
from mech_twin.cli.study_verbs import RegimesVerb, SynthesiseVerb
from mech_twin.files.output_file import YAML_SUFFIXES, check_output_file
from mech_twin.parameters.load import assignments, machine_parameters
from mech_twin.parameters.written_configuration import write_configuration
from mech_twin.process.dependencies import require_extra
from mech_twin.studies import regimes, synthesise

PICTURE = (".png", ".svg", ".pdf")
ROBUST = ("margin", "basin_fraction", "tolerance", "stroke_ratio", "starts", "seed")  # what the cycle is asked for


def answer_synthesise(request: SynthesiseVerb) -> None:
    """Show the cycles side by side; write the configuration of the chosen one."""
    machine, config = request.machine, request.config
    out = request.out or Path(f"{machine}-robust.yaml")
    check_output_file(out, force=request.force, suffixes=YAML_SUFFIXES)
    check_report(request.report, force=request.force)
    with study_errors(), told(f"synthesising a cycle of {machine}"):
        parameters = machine_parameters(machine, config, assignments(request.settings))
        found = synthesise(
            machine,
            request.impact_speed_m_per_s,
            parameters=parameters,
            options={name: getattr(request, name) for name in ROBUST},
            periods=request.periods,
        )
        notes = notes_of(impact_speed_m_per_s=request.impact_speed_m_per_s, seed=request.seed, cycle=found.chosen)
        write_configuration(machine, found.cycle(found.chosen).parameters, out, config, notes)
    if request.report is not None:
        report_synthesis(Studied(request.report, machine, parameters, found.asked), found)
    if request.as_json:
        cycles = {cycle.name: cycle.record for cycle in found.cycles}
        print_json({"machine": machine, **found.asked, **cycles, "chosen": found.chosen, "configuration": str(out)})
        return
    titles = dict.fromkeys(title for cycle in found.cycles for title in cycle.lines)
    rows = [(title, *(cycle.lines.get(title, "-") for cycle in found.cycles)) for title in titles]
    print_table("one-impact cycle", ("", *(cycle.name for cycle in found.cycles)), rows)
    say(f"wrote {out}")


def answer_regimes(asked: RegimesVerb) -> None:
    """Show the regime at each value, equal ones that follow each other in one row; write the bifurcation picture."""
    machine, shape = asked.machine, asked.form
    out = asked.out or Path(f"{machine}-regimes.png")
    check_output_file(out, force=asked.force, suffixes=PICTURE)
    check_report(asked.report, force=asked.force)
    require_extra("plots")
    axes: dict[str, tuple[Any, ...]] = axes_of(asked.over)
    if len(axes) != 1:
        raise CommandError("--over: a regime map has one key")
    ((key, values),) = axes.items()
    with study_errors(), counted("regimes") as progress:
        parameters = machine_parameters(machine, asked.config, assignments(asked.settings))
        found = regimes(machine, values, key, parameters=parameters, settling_periods=asked.settling, progress=progress)
        found.write_picture(out)
    if asked.report is not None:
        options = {"over": asked.over, "settling": asked.settling}
        report_regimes(Studied(asked.report, machine, parameters, options), found, out)
    if shape == "json":
        print_json({"machine": machine, "key": key, "regimes": found.records, "picture": str(out)})
        return
    if shape == "csv":
        print_csv(found.columns, found.rows)
    elif shape == "wide":
        print_table("regimes", found.columns, found.rows, wide=True)
    else:
        spans = joined(found.rows)
        print_table("regimes", ("from", "to", *found.columns[1:]), spans)
        say(f"{len(found.rows)} values of {key} in {len(spans)} rows; each value with --all")
    say(f"wrote {out}")


def joined(rows: Sequence[Sequence[Any]]) -> list[tuple[Any, ...]]:
    """Return rows (value, regime, period, impacts, ..., blow) that follow each other with the same regime as one.

    It has the first and the last value, and of the last column the least and the greatest.
    """
    spans: list[tuple[Any, ...]] = []
    for _, run in groupby(rows, key=lambda row: tuple(row[1:-1])):
        group = list(run)
        blows = [row[-1] for row in group]
        least, most = min(blows), max(blows)
        shown = f"{least:.4g}" if least == most else f"{least:.4g} to {most:.4g}"
        spans.append((group[0][0], group[-1][0], *group[0][1:-1], shown))
    return spans
