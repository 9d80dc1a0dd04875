# SPDX-License-Identifier: Apache-2.0
"""Commands that compare a machine with measured runs; ``main`` names them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mech_twin.cli.failure import CommandError
from mech_twin.cli.option_values import time_option
from mech_twin.cli.options import Config, Force, Json, MachineName, MapFile, Settings


def shadow(
    machine: MachineName,
    followed: Annotated[str, typer.Option("--from", metavar="NAMESPACE", help="namespace of the machine to follow")],
    given_map: MapFile = None,
    config: Config = None,
    settings: Settings = None,
    record: Annotated[
        Path | None, typer.Option(help="directory of a recording of what is received and estimated")
    ] = None,
    duration: Annotated[float, time_option("time after which it ends, s (10, 2min); 0: until stopped")] = 0.0,
    uncertain: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=2%",
            help="standard deviation of a configuration key; may be given several times",
            show_default="2% of each force",
        ),
    ] = None,
    monitor: Annotated[
        Path | None, typer.Option(help="judge each cycle by this reference (`mech-twin monitor --save-baseline`)")
    ] = None,
    black_box: Annotated[
        Path | None, typer.Option(help="folder for a recording of 10 s before and 5 s after each fault")
    ] = None,
    advise: Annotated[
        Path | None, typer.Option(help="advise on an output of the machine: file of targets and limits")
    ] = None,
    view: Annotated[
        str,
        typer.Option(
            metavar="VIEW", help="measured and model over each other: web, light, full, none or file NAME.rrd"
        ),
    ] = "none",
    view_port: Annotated[int, typer.Option(help="port of the page; 0: a free one", min=0, max=65535)] = 0,
    force: Force = False,
    json: Json = False,
) -> None:
    """Follow a running machine by its topics: its state, forces and their uncertainty, below /MACHINE/twin."""
    from mech_twin.cli.shadow import ShadowRequest, shadow_machine

    what = (given_map, config, settings or [], record, duration, uncertain or [])
    shadow_machine(ShadowRequest(machine, followed, *what, monitor, black_box, advise, force, json, view, view_port))


def propose(
    measurement: Annotated[Path, typer.Argument(help="one run: a bag, or a table (.csv, .tsv, .parquet)")],
    machine: MachineName,
    config: Config = None,
    out: Annotated[
        Path | None, typer.Option(help="file (.yaml) to write the map to, instead of standard output")
    ] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Propose the map of a measurement, and show the quality of its data."""
    from mech_twin.cli.map import propose_map

    propose_map(measurement, machine, config, out, force=force, as_json=json)


def identify(
    machine: MachineName,
    runs: Annotated[list[Path] | None, typer.Argument(help="runs: bags or tables")] = None,
    given_map: Annotated[Path | None, typer.Option("--map", help="map of the runs (see `mech-twin map`)")] = None,
    free: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY[=LOW:HIGH]", help="key to be found", show_default="those that the configuration calls assumed"
        ),
    ] = None,
    fix: Annotated[list[str] | None, typer.Option(metavar="KEY", help="key to be kept as it is")] = None,
    prior: Annotated[
        list[str] | None, typer.Option(metavar="KEY=MEAN,SD", help="what is known of a key from elsewhere")
    ] = None,
    hold_out: Annotated[
        str | None,
        typer.Option(
            metavar="RUN|SHARE",
            help="run, or share of each run, that scores the fit",
            show_default="the last of three or more runs, else 0.2",
        ),
    ] = None,
    motion: Annotated[
        str,
        typer.Option(metavar="MOTION", help="what moves the model: auto, measured (the crank) or simulated"),
    ] = "auto",
    begin: Annotated[
        str, typer.Option(metavar="start|unknown", help="where the runs begin: at the start of the machine, or unknown")
    ] = "start",
    latest_begin: Annotated[
        float | None, time_option("latest unknown beginning within the machine's run, s", "10")
    ] = None,
    plan: Annotated[bool, typer.Option("--plan", help="without runs: which keys these sensors would find")] = False,
    sensors: Annotated[Path | None, typer.Option(help="with --plan: sensors as of `simulate --sensors`")] = None,
    duration: Annotated[float | None, time_option("with --plan: length of the run, s")] = None,
    seed: Annotated[int, typer.Option(help="seed of the further starts of the fit", min=0)] = 0,
    cores: Annotated[int | None, typer.Option(help="processor cores to use", min=1, show_default="all")] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Dask scheduler for starts and profiles, tcp://HOST:PORT")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="directory of the results, or file (.yaml) of the configuration")
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", "--base", help="configuration to start from instead of the installed one")
    ] = None,
    settings: Settings = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find parameters of a machine from measured runs, with intervals, verdicts and a held-out score."""
    from mech_twin.cli.identify import identify_machine
    from mech_twin.cli.identify_request import LATEST_BEGIN_S, IdentifyRequest

    for option, value, words in (
        ("--motion", motion, ("auto", "measured", "simulated")),
        ("--begin", begin, ("start", "unknown")),
    ):
        if value not in words:
            raise CommandError(f"{option} {value}: expected one of {', '.join(words)}")
    if latest_begin is not None and begin != "unknown":
        raise CommandError(f"--latest-begin {latest_begin:g}: expected --begin unknown beside it")
    latest_begin_s = LATEST_BEGIN_S if latest_begin is None else latest_begin
    identify_machine(
        IdentifyRequest(
            machine, runs or [], given_map, free or [], hold_out, config, settings or [], out, force, json,
            fix or [], prior or [], motion, begin, latest_begin_s, seed, cores, plan, sensors, duration, scheduler,
        )
    )  # fmt: skip


def monitor(
    machine: MachineName,
    runs: Annotated[list[Path] | None, typer.Argument(help="runs to be judged: bags or tables")] = None,
    given_map: MapFile = None,
    baseline: Annotated[
        Path | None,
        typer.Option(
            help="healthy run, or a file that --save-baseline wrote", show_default="the first part of the runs"
        ),
    ] = None,
    save_baseline: Annotated[
        Path | None, typer.Option(help="file (.json) for baseline, thresholds, signatures")
    ] = None,
    arl0: Annotated[
        float | None,
        typer.Option(help="mean time between false alarms of all charts together, h", min=1e-3, show_default="24"),
    ] = None,
    skip: Annotated[
        float | None,
        time_option("time at the start of each run that is left out, s", "the machine's run-up"),
    ] = None,
    design: Annotated[bool, typer.Option("--design", help="judge a sensor set instead of runs")] = False,
    sensors: Annotated[Path | None, typer.Option(help="with --design: the sensors, as for simulate")] = None,
    seed: Annotated[
        int | None, typer.Option(help="seed of the draws that thresholds come from", min=0, show_default="0")
    ] = None,
    config: Config = None,
    settings: Settings = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Judge runs against a healthy one and name the faults (exit code 1: an alarm), or judge a sensor set."""
    from mech_twin.cli.monitor import SETUP_SUFFIX, MonitorRequest, monitor_machine

    if seed is not None and baseline is not None and baseline.suffix == SETUP_SUFFIX:
        raise CommandError(f"--seed {seed}: {baseline} holds thresholds already; expected a run as --baseline")
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
        seed or 0,
        force,
        json,
    )
    monitor_machine(asked)
