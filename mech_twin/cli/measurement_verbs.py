# SPDX-License-Identifier: Apache-2.0
"""Verbs that compare a machine with measured runs: each a model of its options."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar, Literal

from mech_twin.cli.verb import Excludes, Requires, Rules, argument, option
from mech_twin.cli.verbs import Config, Configured, MachineName, MapFile, Namespace, Written
from mech_twin.files.output_file import YAML_SUFFIXES

FalseAlarms = Annotated[
    float | None, option("mean time between false alarms of a machine, h", None, "--arl0", ge=1e-3, shown="24")
]
Skip = Annotated[
    float | None, option("time at the start of each run that is left out, s", unit="s", shown="the machine's run-up")
]


class ShadowVerb(Configured, answer="shadow:shadow_machine"):
    """Follow a running machine by its topics: its state, forces and their uncertainty, below /MACHINE/twin."""

    rules: ClassVar[Rules] = tuple(
        Requires(each, ("monitor",), "it finds the faults") for each in ("black_box", "mqtt", "prometheus")
    )
    machine: MachineName
    followed: str = option("namespace of the machine to follow", ..., "--from", metavar="NAMESPACE")
    namespace: Namespace = None
    given_map: MapFile = None
    record: Path | None = option("directory of a recording of what is received and estimated")
    duration_s: float = option("time after which it ends, s (10, 2min); 0: until stopped", 0.0, unit="s")
    uncertain: list[str] = option(
        "standard deviation of a configuration key; may be given several times",
        [],
        metavar="KEY=2%",
        shown="2% of each force",
    )
    monitor: Path | None = option("judge each cycle by this reference (`mech-twin monitor --save-baseline`)")
    black_box: Path | None = option("folder for a recording of 10 s before and 5 s after each fault")
    advise: Path | None = option("advise on an output of the machine: file of targets and limits")
    identify: list[str] = option(
        "key that may be identified from the last minutes, when asked; auto: all numbers of the machine",
        [],
        metavar="KEY[=LOW:HIGH]|auto",
    )
    view: str = option("measured and model over each other: web, none or file NAME.rrd", "none", metavar="VIEW")
    view_port: int = option("port of the page; 0: a free one", 0, ge=0, le=65535)
    mqtt: str | None = option("broker that receives each fault (extra: alerts)", metavar="HOST:PORT")
    prometheus: str | None = option("serve the faults as metrics there; :9464 is this host alone", metavar="HOST:PORT")


class MapVerb(Written, answer="measured:propose_map"):
    """Propose the map of a measurement, and show the quality of its data."""

    measurements: list[Path] = argument(
        "runs of one kind: bags, or tables (CSV, TSV, Parquet)", metavar="MEASUREMENT..."
    )
    machine: MachineName
    config: Config = None
    out: Path | None = option("file (.yaml) to write the map to, instead of standard output", writes=YAML_SUFFIXES)


class IdentifyVerb(Configured, answer="identify:identify_machine"):
    """Find parameters of a machine from measured runs, with intervals, verdicts and a held-out score."""

    rules: ClassVar[Rules] = (
        *(
            Excludes("plan", each, "a plan computes no fit")
            for each in ("runs", "hold_out", "motion", "latest_begin_s", "seed", "scheduler", "out")
        ),
        Requires("sensors", ("plan",), "runs have their --map"),
        Requires("duration_s", ("plan",), "runs have their own length"),
        Requires("plan", ("sensors",), "it asks what they would find"),
        Requires("plan", ("duration_s",), "it asks what a run of this length would tell"),
    )
    machine: MachineName
    runs: list[Path] = argument("runs: bags or tables", [])
    map_file: Path | None = option("map of the runs (see `mech-twin map`)", None, "--map")
    free: list[str] = option(
        "key to be found; auto: all numbers of the machine that the channels see",
        [],
        metavar="KEY[=LOW:HIGH]|auto",
        shown="those that the configuration calls assumed",
    )
    fixed: list[str] = option("key to be kept as it is", [], "--fix", metavar="KEY")
    priors: list[str] = option("what is known of a key from elsewhere", [], "--prior", metavar="KEY=MEAN,SD")
    hold_out: str | None = option(
        "run, or share of each run, that scores the fit",
        metavar="RUN|SHARE",
        shown="the last of three or more runs, else 0.2",
    )
    motion: Literal["auto", "measured", "simulated", "bounces"] = option(
        "what moves the model: auto, measured (the crank), simulated, or bounces (no model)", "auto", metavar="MOTION"
    )
    latest_begin_s: float | None = option(
        "the runs begin within the machine's run at an unknown time, at the latest at this, s",
        unit="s",
        shown="its start",
    )
    plan: bool = option("without runs: which keys these sensors would find", False)
    sensors: Path | None = option("with --plan: sensors as of `simulate --sensors`")
    duration_s: float | None = option("with --plan: length of the run, s", unit="s")
    seed: int = option("seed of the further starts of the fit", 0, ge=0)
    cores: int | None = option("processor cores to use", ge=1, shown="all")
    scheduler: str | None = option("Dask scheduler for starts and profiles, tcp://HOST:PORT", metavar="ADDRESS")
    out: Path | None = option("directory of the results, or file (.yaml) of the configuration")


class MonitorVerb(Configured, answer="monitor:monitor_machine"):
    """Judge runs against a healthy one and name the faults (exit code 1: an alarm), or judge a sensor set."""

    rules: ClassVar[Rules] = (
        *(
            Excludes("design", each, "a sensor set is judged without runs")
            for each in ("runs", "map_file", "baseline", "save_baseline", "skip_s", "explain")
        ),
        Requires("design", ("sensors",), "it judges them"),
        Requires("sensors", ("design",), "a run has --map"),
        Requires("picture", ("explain",), "it shows what a fault explains"),
        Requires("renew", ("baseline",), "a file of --save-baseline is renewed"),
        Requires("yes", ("renew",), "nothing else asks"),
        Excludes("renew", "save_baseline", "the file of --baseline is written"),
    )
    machine: MachineName
    runs: list[Path] = argument("runs to be judged: bags or tables", [])
    map_file: MapFile = None
    baseline: list[Path] = option(
        "healthy run, again for more days; or a file that --save-baseline wrote", [], shown="the first part of the runs"
    )
    save_baseline: Path | None = option("file (.json) for baseline, thresholds, signatures", writes=())
    renew: bool = option("take the runs into the baseline file, where none has an alarm and you say yes", False)
    yes: bool = option("with --renew: yes, without a question", False)
    known_arl0_h: FalseAlarms = None
    skip_s: Skip = None
    explain: str | None = option(
        "fault: which features have changed, how far, and what it would do to them", metavar="FAULT"
    )
    picture: Path | None = option(
        "picture (.png or .svg) of the first alarm that is explained", writes=(".png", ".svg"), extra="plots"
    )
    design: bool = option("judge a sensor set instead of runs", False)
    sensors: Path | None = option("with --design: the sensors, as for simulate")
    seed: int | None = option("seed of the draws that thresholds come from", ge=0, shown="0")


class FleetVerb(Configured, answer="monitor:rank_fleet"):
    """Rank machines of one kind, each against its own baseline and its sisters (exit code 1: one is suspect)."""

    machine: MachineName
    folder: Path = argument("folder with a folder for each machine: recordings, and baseline.json if it has one")
    map_file: MapFile = None
    known_arl0_h: FalseAlarms = None
    skip_s: Skip = None
    healthy: int = option("first recordings of each machine that are its baseline, where it has no file", 1, ge=1)
    save_baselines: bool = option("keep each machine's baseline in its folder (baseline.json)", False)
    page: Path | None = option("page to write (.html)", writes=(".html",))
    everything: bool = option("every machine, not the suspect ones alone", False, "--all")
    cores: int | None = option("processor cores to use", ge=1, shown="all")
    scheduler: str | None = option("Dask scheduler to spread over, tcp://HOST:PORT", metavar="ADDRESS")
