"""``mech-twin analyse``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from mech_twin.cli.console import print_json, print_numbers, progress
from mech_twin.cli.failure import CommandError
from mech_twin.configuration_tree import configuration_tree
from mech_twin.parameters.load import assignments
from mech_twin.parameters.load import machine as built_machine
from mech_twin.roles import Machine
from mech_twin.studies.cycle_analysis import analysed_columns, cycle_positions


def analyse_machine(
    name: str, crank_deg: float | None, cycle: int | None, config: Path | None, settings: list[str], *, as_json: bool
) -> None:
    """Write one position, or one cycle in so many positions, and the machine's closed-form metrics."""
    if crank_deg is not None and cycle is not None:
        raise CommandError("--crank-deg and --cycle exclude each other: one position or one cycle")
    if crank_deg is not None and not math.isfinite(crank_deg):
        raise CommandError(f"--crank-deg {crank_deg}: expected a finite angle in degrees")
    machine = built_machine(name, config, assignments(settings))
    document: dict[str, Any] = {"machine": name, "config": configuration_tree(machine.parameters)}
    document["summary"] = machine.report()
    if crank_deg is not None:
        document["crank_deg"] = crank_deg
        document["position"] = machine.analyse(math.radians(crank_deg))
    if cycle is not None:
        document["cycle"] = cycle_columns(machine, cycle)
    if as_json:
        print_json(document)
        return
    print_numbers(f"{name}: one cycle", document["summary"])
    if crank_deg is not None:
        print_numbers(f"{name} at {crank_deg:g} degrees", document["position"])
    if cycle is not None:
        extremes = {f"{key} (least, greatest)": _extremes(column) for key, column in document["cycle"].items()}
        print_numbers(f"{name}: {cycle} positions", extremes)


def _extremes(column: list[Any]) -> str:
    numbers = [value for value in column if isinstance(value, int | float)]
    return f"{min(numbers):.7g}, {max(numbers):.7g}" if numbers else str(column[0])


def cycle_columns(machine: Machine, positions: int) -> dict[str, list[Any]]:
    """Return every number of the analysis over one turn of the crank, as columns; a progress bar runs meanwhile."""
    with progress(cycle_positions(positions), positions, "analysing") as counted:
        return analysed_columns(machine, counted)
