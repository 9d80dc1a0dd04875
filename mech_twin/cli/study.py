# SPDX-License-Identifier: Apache-2.0
"""``mech-twin study MACHINE QUESTION``: the questions and their options; what they write is in `study_output`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mech_twin.cli import completion
from mech_twin.cli.command_group import QuestionGroup
from mech_twin.cli.failure import CommandError
from mech_twin.cli.help_words import Verb
from mech_twin.cli.option_values import machine_name, time_option
from mech_twin.output_file import YAML_SUFFIXES, check_output_file

TABLE = (".parquet", ".csv")
PICTURE = (".png", ".svg", ".pdf")
POINTS = 9  # of a Pareto front

study_app = typer.Typer(
    cls=QuestionGroup,
    subcommand_metavar="QUESTION [OPTIONS]...",
    help="Sweep, size or optimise a machine: mech-twin study MACHINE QUESTION.",
)

Config = Annotated[Path | None, typer.Option("--config", help="configuration file instead of the installed one")]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE...", help="override configuration keys", autocompletion=completion.settings
    ),
]
Force = Annotated[bool, typer.Option("--force", help="overwrite existing results")]
Json = Annotated[bool, typer.Option("--json", help="print JSON to standard output")]
Everything = Annotated[bool, typer.Option("--all", help="every row and column")]
Csv = Annotated[bool, typer.Option("--csv", help="print comma-separated values")]
Cores = Annotated[
    int | None, typer.Option(help="processor cores to use, a process each", min=1, max=1024, show_default="all cores")
]
Scheduler = Annotated[str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler, tcp://HOST:PORT")]
Seed = Annotated[int, typer.Option(help="seed of the random draws; the same seed gives the same answer", min=0)]
Over = Annotated[
    list[str],
    typer.Option(
        "--over",
        metavar="KEY=VALUES...",
        help="from:to:count, from:to:count:log, or a,b,c; several keys make a grid",
        autocompletion=completion.settings,
    ),
]
Limits = Annotated[
    list[str] | None,
    typer.Option(
        "--limit",
        metavar="NAME=VALUE...",
        help="limits that replace the usual ones, SI units",
        autocompletion=completion.limits,
    ),
]
Bounds = Annotated[
    list[str] | None,
    typer.Option(
        "--bound",
        metavar="NAME=LOW:HIGH...",
        help="bounds that replace the usual ones of design variables, SI units",
        autocompletion=completion.bounds,
    ),
]


@study_app.callback(invoke_without_command=True)
def study(
    context: typer.Context,
    machine: Annotated[
        str,
        typer.Argument(
            help="machine, or the beginning of its name (see `mech-twin list`)",
            callback=machine_name,
            autocompletion=completion.machines,
        ),
    ],
) -> None:
    """Sweep, size or optimise a machine."""
    context.obj = machine
    if context.invoked_subcommand is None:
        from mech_twin.studies.asking import questions_of

        raise CommandError(f"study {machine}: name a question after the machine: {', '.join(questions_of(machine))}")


@study_app.command(cls=Verb)
def sweep(
    context: typer.Context,
    over: Over,
    out: Annotated[
        Path | None, typer.Option(help="table to write, NAME.parquet or NAME.csv", show_default="MACHINE-sweep.parquet")
    ] = None,
    number: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="number to tabulate; may be given several times", show_default="all"),
    ] = None,
    duration: Annotated[
        float, time_option("time to simulate at each point, s (3, 500ms); 0: the analysis alone")
    ] = 0.0,
    no_picture: Annotated[bool, typer.Option("--no-picture", help="write the table alone")] = False,
    cores: Cores = None,
    scheduler: Scheduler = None,
    config: Config = None,
    settings: Settings = None,
    everything: Everything = False,
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
) -> None:
    """Sweep configuration keys over a grid; resume an interrupted sweep."""
    from mech_twin.cli.study_output import SweepRequest, answer_sweep

    numbers, table = tuple(number or ()), out or Path(f"{context.obj}-sweep.parquet")
    check_output_file(table, force=force, suffixes=TABLE)
    if not no_picture:
        check_output_file(table.with_suffix(".png"), force=force)
    answer_sweep(
        SweepRequest(context.obj, over, table, numbers, duration, not no_picture, cores, scheduler, everything, csv),
        config,
        settings or [],
        as_json=json,
    )


@study_app.command(cls=Verb)
def size(
    context: typer.Context,
    out: Annotated[Path | None, typer.Option(help="configuration to write", show_default="MACHINE-sized.yaml")] = None,
    objective: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="quantity to minimise",
            show_default="the usual one of the machine",
            autocompletion=completion.objectives,
        ),
    ] = None,
    limit: Limits = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="relative tolerance of each assumed value within which the limits hold",
            show_default="the usual one of the machine",
        ),
    ] = None,
    config: Config = None,
    settings: Settings = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Size spring and preload, flywheel, counterweight, or motor and drive; say which constraint binds."""
    from mech_twin.cli.study_output import answer_size

    file = out or Path(f"{context.obj}-sized.yaml")
    check_output_file(file, force=force, suffixes=YAML_SUFFIXES)
    answer_size(context.obj, file, objective, limit or [], tolerance, config, settings or [], as_json=json)


@study_app.command(cls=Verb)
def search(
    context: typer.Context,
    objective: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="quantity to minimise; several give a Pareto front",
            show_default="the usual one of the machine",
            autocompletion=completion.objectives,
        ),
    ] = None,
    bound: Bounds = None,
    limit: Limits = None,
    seed: Seed = 1,
    points: Annotated[
        int | None, typer.Option(help="points of a Pareto front", min=1, max=1000, show_default="9")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="configuration to write", show_default="MACHINE-found.yaml")] = None,
    config: Config = None,
    settings: Settings = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Choose a machine's dimensions: scan, then optimise; a Pareto front for several objectives."""
    from mech_twin.cli.study_design import DesignRequest, answer_search

    if points is not None and len(objective or ()) < 2:
        raise CommandError(f"--points {points}: expected several --objective, which give a Pareto front")
    file = out or Path(f"{context.obj}-found.yaml")
    check_output_file(file, force=force, suffixes=YAML_SUFFIXES)
    request = DesignRequest(context.obj, bound or [], limit or [], seed, config, settings or [])
    answer_search(request, tuple(objective or ()), points or POINTS, file, as_json=json)


@study_app.command(cls=Verb)
def designs(
    context: typer.Context,
    count: Annotated[int, typer.Option(help="random designs to evaluate", min=1, max=1_000_000_000)] = 1_000_000,
    bound: Bounds = None,
    limit: Limits = None,
    seed: Seed = 1,
    out: Annotated[Path | None, typer.Option(help="Parquet file of the feasible designs")] = None,
    cores: Cores = None,
    scheduler: Scheduler = None,
    config: Config = None,
    settings: Settings = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Evaluate random designs of a machine, a million or more."""
    if out is not None:
        check_output_file(out, force=force, suffixes=(".parquet",))
    from mech_twin.cli.study_design import DesignRequest, answer_designs

    request = DesignRequest(context.obj, bound or [], limit or [], seed, config, settings or [])
    answer_designs(request, count, out, cores, scheduler, as_json=json)


@study_app.command(cls=Verb)
def synthesise(
    context: typer.Context,
    impact_speed: Annotated[float, typer.Option(help="target impact speed, m/s")] = 20.0,
    margin: Annotated[float, typer.Option(help="stability margin: least 1 - |largest multiplier|")] = 0.1,
    basin: Annotated[
        float, typer.Option(help="basin of attraction: least share of random starts that reach the cycle")
    ] = 0.999,
    tolerance: Annotated[
        float, typer.Option(help="relative tolerance of P1, P2, t1, T and R within which the cycle persists")
    ] = 0.01,
    stroke_ratio: Annotated[float, typer.Option(help="upper limit of the largest gap over the stroke")] = 2.5,
    starts: Annotated[int, typer.Option(help="random starts that test the basin, at most 1000000", min=1)] = 1000,
    seed: Seed = 1,
    periods: Annotated[
        int, typer.Option(help="length of the endurance runs in periods, at most 1000000000", min=1)
    ] = 1_000_000,
    out: Annotated[
        Path | None, typer.Option(help="robust configuration to write", show_default="MACHINE-robust.yaml")
    ] = None,
    config: Config = None,
    settings: Settings = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Synthesise a one-impact cycle as published, and a robust one beside it."""
    from mech_twin.cli.study_long_run import SynthesisRequest, answer_synthesise

    file = out or Path(f"{context.obj}-robust.yaml")
    check_output_file(file, force=force, suffixes=YAML_SUFFIXES)
    request = SynthesisRequest(impact_speed, margin, basin, tolerance, stroke_ratio, starts, seed, periods, file)
    answer_synthesise(context.obj, request, config, settings or [], as_json=json)


@study_app.command(cls=Verb)
def regimes(
    context: typer.Context,
    over: Over,
    settling: Annotated[int, typer.Option(help="settling periods left out, at most 100000", min=1)] = 1000,
    out: Annotated[
        Path | None,
        typer.Option(help="bifurcation diagram to write (.png, .svg, .pdf)", show_default="MACHINE-regimes.png"),
    ] = None,
    config: Config = None,
    settings: Settings = None,
    everything: Everything = False,
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
) -> None:
    """Map the long-run regimes of a machine over one key; draw the bifurcation diagram."""
    from mech_twin.cli.analyse import Shape
    from mech_twin.cli.study_long_run import answer_regimes

    file = out or Path(f"{context.obj}-regimes.png")
    check_output_file(file, force=force, suffixes=PICTURE)
    shape: Shape = "json" if json else "csv" if csv else "wide" if everything else "narrow"
    answer_regimes(context.obj, over, settling, file, config, settings or [], shape)
