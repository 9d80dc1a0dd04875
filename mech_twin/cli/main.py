"""The ``mech-twin`` command: its verbs and their options.  What a verb does is in a file of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mech_twin import __version__
from mech_twin.cli.failure import CommandError, told_in_one_line
from mech_twin.cli.many_values import ManyValues
from mech_twin.cli.study import study_app

app = typer.Typer(
    name="mech-twin",
    help="Digital twin of percussion and crank-linkage machines.",
    no_args_is_help=False,
    add_completion=False,
    pretty_exceptions_enable=False,
)

MachineName = Annotated[str, typer.Argument(help="machine of the catalogue (see `mech-twin list`)")]
Config = Annotated[Path | None, typer.Option("--config", help="configuration file instead of the installed one")]
Settings = Annotated[list[str] | None, typer.Option("--set", metavar="KEY.PATH=VALUE", help="override one key")]
Bag = Annotated[Path, typer.Argument(help="a recording: its directory, or one .mcap file")]
Json = Annotated[bool, typer.Option("--json", help="JSON on standard output")]


def _show_version(asked: bool) -> None:
    if asked:
        typer.echo(f"mech-twin {__version__}")
        raise typer.Exit


@app.callback(invoke_without_command=True)
def root(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", callback=_show_version, is_eager=True, help="version")] = False,
) -> None:
    """Digital twin of percussion and crank-linkage machines."""
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


@app.command("list")
def list_machines(json: Json = False) -> None:
    """List the machines there are."""
    from mech_twin.cli.catalogue import show_catalogue

    show_catalogue(as_json=json)


@app.command()
def run(
    machine: MachineName = "mb10_breaker",
    pace: Annotated[str, typer.Option(help="realtime or max")] = "realtime",
    duration: Annotated[float, typer.Option(help="simulated seconds; 0 runs until stopped", min=0.0)] = 0.0,
    record: Annotated[Path | None, typer.Option(help="recording to make [recordings/MACHINE-DATE]")] = None,
    no_record: Annotated[bool, typer.Option("--no-record", help="make no recording")] = False,
    view: Annotated[str, typer.Option(help="web, none, or a file to write (NAME.rrd)")] = "web",
    view_port: Annotated[int, typer.Option(help="port of the web view; 0 takes a free one", min=0, max=65535)] = 0,
    processes: Annotated[bool, typer.Option("--processes", help="give each node its own process")] = False,
    open_to_other_hosts: Annotated[
        bool, typer.Option("--open-to-other-hosts", help="open topics and view to the network, without password")
    ] = False,
    config: Config = None,
    settings: Settings = None,
    json: Json = False,
) -> None:
    """Run a machine as ROS 2 nodes, recorded and shown."""
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
    )
    run_machine(request)


@app.command()
def simulate(
    machine: MachineName,
    duration: Annotated[float, typer.Option(help="simulated seconds", min=0.0)],
    bag: Annotated[Path | None, typer.Option(help="write what the nodes would have published")] = None,
    samples: Annotated[bool, typer.Option("--samples", help="with --json: every sample, as columns")] = False,
    config: Config = None,
    settings: Settings = None,
    json: Json = False,
) -> None:
    """Simulate a machine in this process, without ROS communication."""
    from mech_twin.cli.simulate import simulate_machine

    simulate_machine(machine, duration, bag, config, settings or [], as_json=json, with_samples=samples)


@app.command()
def analyse(
    machine: MachineName,
    crank_deg: Annotated[float | None, typer.Option(help="one crank position, degrees")] = None,
    cycle: Annotated[int | None, typer.Option(help="so many positions of one cycle", min=2, max=1_000_000)] = None,
    config: Config = None,
    settings: Settings = None,
    json: Json = False,
) -> None:
    """Analyse one position or one cycle: every angle, speed, force and constant."""
    from mech_twin.cli.analyse import analyse_machine

    analyse_machine(machine, crank_deg, cycle, config, settings or [], as_json=json)


@app.command(cls=ManyValues)
def replay(
    bag: Bag,
    rate: Annotated[float, typer.Option(help="recorded seconds per second")] = 1.0,
    start: Annotated[float, typer.Option(help="begin at this time of the recording, s")] = 0.0,
    duration: Annotated[float | None, typer.Option(help="replay so many seconds of it")] = None,
    loop: Annotated[bool, typer.Option("--loop", help="begin again at the end")] = False,
    clock: Annotated[bool, typer.Option("--clock", help="tell the time on /clock oneself")] = False,
    topics: Annotated[list[str] | None, typer.Option("--topics", metavar="T...", help="only these topics")] = None,
    listeners: Annotated[int, typer.Option(help="wait for so many subscribers on each topic", min=0)] = 0,
    analyse: Annotated[bool, typer.Option("--analyse", help="compute the forces again from the motion")] = False,
    resimulate: Annotated[bool, typer.Option("--resimulate", help="compute the whole run again")] = False,
    json: Json = False,
) -> None:
    """Publish a recording on its topics, or compute it again and compare to the last bit (exit code 1: differs)."""
    if analyse and resimulate:
        raise CommandError("--analyse and --resimulate exclude each other: forces alone, or the whole run")
    if analyse or resimulate:
        from mech_twin.cli.compare import compare_bag

        compare_bag(bag, "analyse" if analyse else "resimulate", as_json=json)
        return
    from mech_twin.cli.replay import ReplayRequest, replay_bag

    replay_bag(ReplayRequest(bag, rate, start, duration, loop, clock, topics or [], listeners))


@app.command()
def view(
    bag: Bag,
    save: Annotated[Path | None, typer.Option(help="write NAME.rrd instead of showing it")] = None,
    port: Annotated[int, typer.Option(help="port of the web view; 0 takes a free one", min=0, max=65535)] = 0,
) -> None:
    """Show a recording the same way as a live run."""
    from mech_twin.cli.view import view_bag

    view_bag(bag, save, port)


@app.command()
def info(bag: Bag, json: Json = False) -> None:
    """Say what a recording holds, and what it lost."""
    from mech_twin.cli.info import show_info

    show_info(bag, as_json=json)


@app.command()
def recover(
    bag: Bag, out: Annotated[Path, typer.Argument(help="directory of the new recording")], json: Json = False
) -> None:
    """Make a sound recording out of what is intact of another."""
    from mech_twin.cli.recover import recover_bag

    recover_bag(bag, out, as_json=json)


@app.command()
def reproduce(
    machine: Annotated[str | None, typer.Argument(help="machine of the catalogue; all if absent")] = None,
    figures: Annotated[Path | None, typer.Option(help="directory to draw the sources' figures in")] = None,
    config: Config = None,
    settings: Settings = None,
    json: Json = False,
) -> None:
    """Compare every published number with the computed one; draw the published figures."""
    from mech_twin.cli.reproduce import reproduce_machines

    reproduce_machines(machine, figures, config, settings or [], as_json=json)


app.add_typer(study_app, name="study")


def main() -> None:
    """Run the command line."""
    with told_in_one_line():
        code = app(standalone_mode=False)
    raise SystemExit(code if isinstance(code, int) else 0)
