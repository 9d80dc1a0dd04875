"""Answers of ``mech-twin study MACHINE synthesise`` and ``regimes``."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from mech_twin.cli.console import print_json, print_table, say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.study_options import axes_of, counted, notes_of, study_errors
from mech_twin.dependencies import require_extra
from mech_twin.parameters.load import assignments, machine_parameters
from mech_twin.parameters.written_configuration import write_configuration
from mech_twin.studies import regimes, synthesise


class SynthesisRequest(NamedTuple):
    """What cycle is wanted, as it stands on the command line."""

    impact_speed_m_per_s: float
    margin: float
    basin_fraction: float
    tolerance: float
    stroke_ratio: float
    starts: int
    seed: int
    periods: int
    out: Path

    @property
    def options(self) -> dict[str, float | int]:
        """What is asked of the robust cycle, by name."""
        names = ("margin", "basin_fraction", "tolerance", "stroke_ratio", "starts", "seed")
        return {name: getattr(self, name) for name in names}


def answer_synthesise(
    machine: str, request: SynthesisRequest, config: Path | None, settings: list[str], *, as_json: bool
) -> None:
    """Show the cycles side by side; write the configuration of the chosen one."""
    with study_errors():
        parameters = machine_parameters(machine, config, assignments(settings))
        found = synthesise(
            machine,
            request.impact_speed_m_per_s,
            parameters=parameters,
            options=request.options,
            periods=request.periods,
        )
        notes = notes_of(impact_speed_m_per_s=request.impact_speed_m_per_s, seed=request.seed, cycle=found.chosen)
        write_configuration(machine, found.cycle(found.chosen).parameters, request.out, config, notes)
    if as_json:
        cycles = {cycle.name: cycle.record for cycle in found.cycles}
        print_json({"machine": machine, **found.asked, **cycles, "configuration": str(request.out)})
        return
    titles = dict.fromkeys(title for cycle in found.cycles for title in cycle.lines)
    rows = [(title, *(cycle.lines.get(title, "-") for cycle in found.cycles)) for title in titles]
    print_table("one-impact cycle", ("", *(cycle.name for cycle in found.cycles)), rows)
    say(f"wrote {request.out}")


def answer_regimes(
    machine: str,
    over: list[str],
    settling: int,
    out: Path,
    config: Path | None,
    settings: list[str],
    *,
    as_json: bool,
) -> None:
    """Show the regime at each value; write the bifurcation picture."""
    require_extra("plots")
    axes: dict[str, tuple[Any, ...]] = axes_of(over)
    if len(axes) != 1:
        raise CommandError("--over: a regime map has one key")
    ((key, values),) = axes.items()
    with study_errors(), counted("regimes") as progress:
        parameters = machine_parameters(machine, config, assignments(settings))
        found = regimes(machine, values, key, parameters=parameters, settling_periods=settling, progress=progress)
        found.write_picture(out)
    if as_json:
        print_json({"machine": machine, "key": key, "regimes": found.records, "picture": str(out)})
        return
    print_table("regimes", found.columns, found.rows)
    say(f"wrote {out}")
