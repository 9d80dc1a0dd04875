# SPDX-License-Identifier: Apache-2.0
"""The ``mech-twin`` command: its verbs and their options.  Each verb is implemented in a file of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mech_twin import __version__
from mech_twin.cli import completion
from mech_twin.cli.command_group import CommandGroup
from mech_twin.cli.compile_progress import compiling_shown
from mech_twin.cli.failure import INTERRUPTED, CommandError, report_cli_errors
from mech_twin.cli.help_words import Verb
from mech_twin.cli.many_values import ManyValues
from mech_twin.cli.measurement_commands import identify, monitor, propose, shadow
from mech_twin.cli.option_values import machine_name, time_option
from mech_twin.cli.options import (
    Bag,
    BagOrTable,
    Config,
    Csv,
    Everything,
    Force,
    Json,
    MachineName,
    MapFile,
    Namespace,
    Settings,
    Wide,
)
from mech_twin.cli.study import study_app
from mech_twin.interruption import EXIT_CODE_BASE, end_at_once
from mech_twin.output_file import check_output_directory

app = typer.Typer(
    name="mech-twin",
    cls=CommandGroup,
    help="Digital twin of percussion and crank-linkage machines.",
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    pretty_exceptions_enable=False,
)


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"mech-twin {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="print the version")
    ] = False,
) -> None:
    """Digital twin of percussion and crank-linkage machines."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command("list", cls=Verb)
def list_machines(json: Json = False) -> None:
    """List available machines."""
    from mech_twin.cli.catalogue import show_catalogue

    show_catalogue(as_json=json)


@app.command(cls=Verb)
def run(
    machine: MachineName = "mb10_breaker",
    pace: Annotated[
        str | None, typer.Option(metavar="realtime|max", help="pace of the run", show_default="run.pace, else realtime")
    ] = None,
    duration: Annotated[
        float | None,
        time_option("simulated time, s (10, 2min); 0: until stopped", "run.duration_s, else 0"),
    ] = None,
    record: Annotated[
        Path | None, typer.Option(help="recording directory", show_default="recordings/MACHINE-DATE")
    ] = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="do not record")] = False,
    view: Annotated[
        str,
        typer.Option(
            metavar="VIEW", help="web (full or light, as the graphics allow), light, full, none, or a file NAME.rrd"
        ),
    ] = "web",
    view_port: Annotated[int, typer.Option(help="port of the web view; 0: any free port", min=0, max=65535)] = 0,
    hold: Annotated[bool, typer.Option("--hold", help="keep the web view after the run, until Ctrl-C")] = False,
    processes: Annotated[bool, typer.Option("--processes", help="run each node in its own process")] = False,
    namespace: Namespace = None,
    open_to_other_hosts: Annotated[
        bool,
        typer.Option("--open-to-other-hosts", help="expose topics and web view to the network, without authentication"),
    ] = False,
    config: Config = None,
    settings: Settings = None,
    everything: Everything = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Run a machine as ROS 2 nodes, with recorder and viewer."""
    from mech_twin.cli.run import RunRequest, run_machine

    recording = None if no_record else record or "default"
    request = RunRequest(
        machine,
        pace,
        duration,
        recording,
        view,
        view_port,
        processes,
        config,
        settings or [],
        json,
        open_to_other_hosts,
        namespace,
        force,
        everything,
        hold,
    )
    run_machine(request)


@app.command(cls=Verb)
def simulate(
    machine: MachineName,
    duration: Annotated[float, time_option("simulated time, s (3, 500ms, 2min)")],
    bag: Annotated[
        Path | None, typer.Option(help="recording (MCAP) of the messages that the nodes would publish")
    ] = None,
    table: Annotated[Path | None, typer.Option(help="table of every sample (.parquet, .csv, .tsv)")] = None,
    sensors: Annotated[
        Path | None, typer.Option(help="sensors (.yaml) through which the run is written instead")
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=VALUE@S",
            help="change a live parameter at time S, s; a value of -20% is relative",
            autocompletion=completion.live_settings,
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="seed of the noise, jitter and losses of the sensors", min=0)] = 0,
    samples: Annotated[bool, typer.Option("--samples", help="with --json: include every sample, as columns")] = False,
    config: Config = None,
    settings: Settings = None,
    everything: Everything = False,
    force: Force = False,
    csv: Csv = False,
    json: Json = False,
) -> None:
    """Simulate a machine in one process, without ROS communication."""
    from mech_twin.cli.simulate import SimulateRequest, simulate_machine

    asked = SimulateRequest(
        *(machine, duration, bag, config, settings or [], json, samples, force, table, sensors, change or [], seed),
        everything=everything,
        as_csv=csv,
    )
    simulate_machine(asked)


@app.command(cls=Verb)
def analyse(
    machine: MachineName,
    crank_deg: Annotated[float | None, typer.Option(help="crank angle, degrees")] = None,
    cycle: Annotated[int | None, typer.Option(help="positions over one cycle", min=2, max=1_000_000)] = None,
    config: Config = None,
    settings: Settings = None,
    wide: Wide = False,
    csv: Csv = False,
    json: Json = False,
) -> None:
    """Analyse one position or one cycle: kinematics, forces and machine constants."""
    from mech_twin.cli.analyse import Shape, analyse_machine

    shape: Shape = "json" if json else "csv" if csv else "wide" if wide else "narrow"
    analyse_machine(machine, crank_deg, cycle, config, settings or [], shape)


@app.command(cls=ManyValues)
def replay(
    bag: BagOrTable,
    rate: Annotated[float, typer.Option(help="playback rate: recorded seconds per second")] = 1.0,
    start: Annotated[float, time_option("start time within the recording, s")] = 0.0,
    duration: Annotated[float | None, time_option("duration to replay, s")] = None,
    loop: Annotated[bool, typer.Option("--loop", help="repeat until stopped")] = False,
    clock: Annotated[bool, typer.Option("--clock", help="publish /clock from the playback time")] = False,
    topics: Annotated[list[str] | None, typer.Option("--topics", metavar="T...", help="only these topics")] = None,
    listeners: Annotated[int, typer.Option(help="subscribers to wait for on each topic", min=0)] = 0,
    namespace: Namespace = None,
    analyse: Annotated[
        bool, typer.Option("--analyse", help="recompute the forces from the recorded motion and compare")
    ] = False,
    resimulate: Annotated[bool, typer.Option("--resimulate", help="recompute the whole run and compare")] = False,
    given_map: MapFile = None,
    config: Config = None,
    tolerance: Annotated[
        float | None, typer.Option(help="with --analyse: allowed relative difference from the model", min=0.0)
    ] = None,
    json: Json = False,
) -> None:
    """Replay a recording on its topics, or recompute it and compare bit for bit (exit code 1: different)."""
    if given_map is not None:
        if not analyse:
            raise CommandError(
                f"--map {given_map}: a measured run has no topics of the twin; expected --analyse beside it"
            )
        from mech_twin.cli.measured_run import analyse_measured

        analyse_measured(bag, given_map, config, tolerance, as_json=json)
        return
    if analyse or resimulate:
        from mech_twin.cli.recompute import recompute_bag

        recompute_bag(bag, "analyse" if analyse else "resimulate", config, tolerance or 0.0, as_json=json)
        return
    from mech_twin.cli.replay import ReplayRequest, replay_bag

    replay_bag(ReplayRequest(bag, rate, start, duration, loop, clock, topics or [], listeners, namespace))


@app.command(cls=Verb)
def view(
    bag: BagOrTable,
    given_map: MapFile = None,
    config: Config = None,
    save: Annotated[Path | None, typer.Option(help="write a file NAME.rrd instead of opening the view")] = None,
    port: Annotated[int, typer.Option(help="port of the web view; 0: any free port", min=0, max=65535)] = 0,
    force: Force = False,
) -> None:
    """Show a recording in the viewer; with a map, the mechanism in a measured motion."""
    from mech_twin.cli.view import view_bag

    view_bag(bag, save, port, given_map, config, force=force)


@app.command(cls=Verb)
def info(
    bag: BagOrTable,
    given_map: MapFile = None,
    config: Config = None,
    wide: Annotated[bool, typer.Option("--wide", help="all columns, whatever the width of the terminal")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="print the table of topics as CSV")] = False,
    json: Json = False,
) -> None:
    """Describe a recording: what, how long, whether complete; with a map, the quality of a measurement's channels."""
    from mech_twin.cli.info import show_info

    if given_map is not None:
        from mech_twin.cli.measurement import examine_by_file

        examine_by_file(bag, given_map, config, as_json=json)
        return
    show_info(bag, as_json=json, as_csv=csv, wide=wide)


@app.command(cls=Verb)
def compare(
    first: Annotated[str, typer.Argument(metavar="A", help="recording, configuration file (.yaml) or machine")],
    second: Annotated[str, typer.Argument(metavar="B", help="what to compare it with, of the same machine")],
    tolerance: Annotated[float, typer.Option(help="allowed relative difference", min=0.0, max=1.0)] = 0.0,
    duration: Annotated[
        float | None,
        time_option("time to simulate a configuration, s", "that of the recording, else 3"),
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="picture (.png or .svg) of what differs")] = None,
    all_numbers: Annotated[bool, typer.Option("--all", help="all numbers, not only those that differ")] = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Compare two recordings or configurations (exit code 1: a number differs by more than the tolerance)."""
    from mech_twin.cli.compare import compare_sides

    compare_sides(first, second, tolerance, duration, picture, all_numbers=all_numbers, force=force, as_json=json)


@app.command(cls=Verb)
def recover(
    bag: Bag,
    out: Annotated[Path, typer.Argument(help="directory of the new recording")],
    force: Force = False,
    json: Json = False,
) -> None:
    """Salvage a damaged recording: write its intact part into a new one."""
    from mech_twin.cli.recover import recover_bag

    recover_bag(bag, out, force=force, as_json=json)


@app.command(cls=Verb)
def reproduce(
    machine: Annotated[
        str | None,
        typer.Argument(
            help="machine, or the beginning of its name; all if absent",
            callback=machine_name,
            autocompletion=completion.machines,
        ),
    ] = None,
    figures: Annotated[Path | None, typer.Option(help="directory for the figures of the sources")] = None,
    config: Config = None,
    settings: Settings = None,
    wide: Annotated[bool, typer.Option("--wide", help="every column, whatever the width of the terminal")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="every column as CSV")] = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Compare every published number with the computed one; draw the published figures."""
    if figures is not None:
        check_output_directory(figures, force=force)
    from mech_twin.cli.reproduce import Shape, reproduce_machines

    shape: Shape = "json" if json else "csv" if csv else "wide" if wide else "narrow"
    reproduce_machines(machine, figures, config, settings or [], shape=shape)


app.command(cls=Verb)(shadow)
app.command("map", cls=Verb)(propose)
app.command(cls=Verb)(identify)
app.command(cls=Verb)(monitor)
app.add_typer(study_app, name="study")


def main() -> None:
    """Run the command line."""
    try:
        with report_cli_errors(), compiling_shown():
            code = app(prog_name="mech-twin", standalone_mode=False)
            if code == INTERRUPTED:  # the command line library turns KeyboardInterrupt into this code
                raise KeyboardInterrupt
    except SystemExit as end:
        if isinstance(end.code, int) and end.code > EXIT_CODE_BASE:
            end_at_once(end.code)
        raise
    raise SystemExit(code if isinstance(code, int) else 0)
