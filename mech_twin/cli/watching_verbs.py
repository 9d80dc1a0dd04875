"""Verbs that watch a machine: what it does now, and what it did in a recording."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mech_twin.cli.usual_options import Bag, Config, Force, Json, MachineName, MapFile, Settings


def shadow(
    machine: MachineName,
    followed: Annotated[str, typer.Option("--from", metavar="NAMESPACE", help="namespace of the machine to follow")],
    given_map: MapFile = None,
    config: Config = None,
    settings: Settings = None,
    record: Annotated[Path | None, typer.Option(help="directory to record what is heard and said in")] = None,
    duration: Annotated[float, typer.Option(help="time in s after which it ends; 0: until stopped", min=0.0)] = 0.0,
    uncertain: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=2%", help="standard deviation of a configuration key; several [2 % of each force]"),
    ] = None,
    monitor: Annotated[
        Path | None, typer.Option(help="judge each cycle by this reference (`mech-twin monitor --save-baseline`)")
    ] = None,
    black_box: Annotated[
        Path | None, typer.Option(help="folder for a recording of 10 s before and 5 s after each fault")
    ] = None,
    advise: Annotated[
        Path | None, typer.Option(help="advise on an output of the machine: file of what is wanted and allowed")
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Follow a running machine by its topics: its state, forces and their uncertainty, below /MACHINE/twin."""
    from mech_twin.cli.shadow import ShadowRequest, shadow_machine

    what = (given_map, config, settings or [], record, duration, uncertain or [])
    shadow_machine(ShadowRequest(machine, followed, *what, monitor, black_box, advise, force, json))


def monitor(
    machine: MachineName,
    runs: Annotated[list[Path] | None, typer.Argument(help="runs to be judged: bags or tables")] = None,
    given_map: MapFile = None,
    baseline: Annotated[
        Path | None, typer.Option(help="healthy run, or a file that --save-baseline wrote [the first part of the runs]")
    ] = None,
    save_baseline: Annotated[
        Path | None, typer.Option(help="file (.json) for baseline, thresholds, signatures")
    ] = None,
    arl0: Annotated[
        float, typer.Option(help="stated mean time between false alarms of all charts together, h", min=1e-3)
    ] = 24.0,
    skip: Annotated[
        float | None,
        typer.Option(help="time at the start of each run that is left out, s [the machine's run-up]", min=0.0),
    ] = None,
    design: Annotated[bool, typer.Option("--design", help="judge a sensor set instead of runs")] = False,
    sensors: Annotated[Path | None, typer.Option(help="with --design: the sensors, as for simulate")] = None,
    seed: Annotated[int, typer.Option(help="of the draws that thresholds come from", min=0)] = 0,
    config: Config = None,
    settings: Settings = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Judge runs against a healthy one and name the faults (exit code 1: an alarm), or judge a sensor set."""
    from mech_twin.cli.monitor import MonitorRequest, monitor_machine

    asked = MonitorRequest(
        machine,
        runs or [],
        given_map,
        config,
        settings or [],
        baseline,
        save_baseline,
        arl0,
        skip,
        design,
        sensors,
        seed,
        force,
        json,
    )
    monitor_machine(asked)


def view(
    bag: Bag,
    given_map: MapFile = None,
    config: Config = None,
    save: Annotated[Path | None, typer.Option(help="write a file NAME.rrd instead of opening the view")] = None,
    port: Annotated[int, typer.Option(help="port of the web view; 0: any free port", min=0, max=65535)] = 0,
    force: Force = False,
) -> None:
    """Show a recording in the viewer; with a map, the mechanism in a measured motion."""
    from mech_twin.cli.view import view_bag

    view_bag(bag, save, port, given_map, config, force=force)
