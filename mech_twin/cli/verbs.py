# SPDX-License-Identifier: Apache-2.0
"""Verbs on machines and recordings: each a model of its options, answered by a file of its own."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from mech_twin.cli.verb import Excludes, Requires, Rules, Verb, argument, option

if TYPE_CHECKING:
    from mech_twin.declarations.quantity import Parameters
    from mech_twin.roles import Machine

MachineName = Annotated[
    str, argument("machine, or the beginning of its name (see `mech-twin list`)", complete="machines")
]
Config = Annotated[Path | None, option("configuration file instead of the installed one")]
Settings = Annotated[
    list[str],
    option(
        "override configuration keys, such as body.spring_rate_n_per_m=4e4",
        [],
        "--set",
        metavar="KEY=VALUE...",
        complete="settings",
    ),
]
Namespace = Annotated[str | None, option("namespace of the nodes instead of the machine's name", metavar="NAME")]
Bag = Annotated[Path, argument("recording: a directory, or one .mcap or .db3 file")]
BagOrTable = Annotated[
    Path,
    argument(
        "recording: a directory, or one .mcap or .db3 file; with --map also a table (.csv, .tsv, .parquet)",
        metavar="BAG",
    ),
]
MapFile = Annotated[
    Path | None, option("map of a measurement: which channel is what (see `mech-twin map`)", None, "--map")
]
Force = Annotated[bool, option("overwrite existing results", False)]
Json = Annotated[bool, option("print JSON to standard output", False, "--json")]
Everything = Annotated[bool, option("every number and event, not only the headlines", False, "--all")]
Csv = Annotated[bool, option("print comma-separated values", False, "--csv")]
Wide = Annotated[bool, option("every column, whatever the width of the terminal", False)]
Port = Annotated[int, option("port of the web view; 0: any free port", 0, ge=0, le=65535)]


class Written(Verb):
    """A verb that writes files, and prints JSON if asked."""

    force: Force = False
    as_json: Json = False


class Configured(Written):
    """A verb on a machine as it is configured."""

    machine: Any
    config: Config = None
    settings: Settings = []

    @cached_property
    def parameters(self) -> Parameters:
        """The configuration, with its settings."""
        from mech_twin.parameters.load import assignments, machine_parameters

        return machine_parameters(self.machine, self.config, assignments(self.settings))

    @cached_property
    def built(self) -> Machine:
        """The machine as it is configured."""
        from mech_twin.parameters.load import assignments, machine

        return machine(self.machine, self.config, assignments(self.settings))


class ListVerb(Verb, answer="machines:show_catalogue"):
    """List available machines."""

    as_json: Json = False


class RunVerb(Configured, answer="run:run_machine"):
    """Run a machine as ROS 2 nodes, with recorder and viewer."""

    rules: ClassVar[Rules] = (
        Excludes("record", "no_record", "a recording or none"),
        Excludes("snapshot_s", "no_record", "the last seconds are a recording"),
    )
    machine: MachineName = "mb10_breaker"
    pace: Literal["realtime", "max"] | None = option(
        "pace of the run", metavar="realtime|max", shown="run.pace, else realtime"
    )
    duration_s: float | None = option(
        "simulated time, s (10, 2min); 0: until stopped", unit="s", shown="run.duration_s, else 0"
    )
    record: Path | None = option("recording directory", shown="recordings/MACHINE-DATE")
    snapshot_s: float | None = option(
        "record only this time before each trigger (`tell MACHINE snapshot`) and alarm, s",
        unit="s",
        shown="run.snapshot_s, else 0",
    )
    no_record: bool = option("do not record", False)
    view: str = option("web: a page to watch and to command; none; or a file NAME.rrd for rerun", "web", metavar="VIEW")
    view_port: Port = 0
    hold: bool = option("keep the web view after the run, until Ctrl-C", False)
    processes: bool = option("run each node in its own process", False)
    motor: str | None = option("class of your own in the place of the motor", metavar="MODULE:CLASS")
    forces: str | None = option("the same for the force analysis", metavar="MODULE:CLASS")
    body: str | None = option("the same for the body", metavar="MODULE:CLASS")
    namespace: Namespace = None
    open_to_other_hosts: bool = option("expose topics and web view to the network, without authentication", False)
    everything: Everything = False


class SimulateVerb(Configured, answer="simulate:simulate_machine"):
    """Simulate a machine in one process, without ROS communication."""

    rules: ClassVar[Rules] = (
        Excludes("as_csv", "everything", "CSV has every number; events are in --json"),
        Requires("samples", ("as_json",), "samples are printed as JSON; --table FILE writes them"),
        Requires("seed", ("sensors",), "a run without sensors draws nothing at random"),
        Requires("sensors", ("bag", "table"), "what they show is written there"),
    )
    machine: MachineName
    duration_s: float = option("simulated time, s (3, 500ms, 2min)", ..., unit="s")
    bag: Path | None = option("recording (MCAP) of the messages that the nodes would publish")
    table: Path | None = option("table of every sample (.parquet, .csv, .tsv)", writes=(".parquet", ".csv", ".tsv"))
    energy: Path | None = option(
        "picture (.png or .svg) of the energy flow of each element over the last cycle",
        writes=(".png", ".svg"),
        extra="plots",
    )
    sensors: Path | None = option("sensors (.yaml) through which the run is written instead")
    change: list[str] = option(
        "change a live parameter, motor.command or the operating point at S, s; S..S is a ramp, -20% relative",
        [],
        metavar="KEY=VALUE@S",
        complete="live_settings",
    )
    seed: int = option("seed of the noise, jitter and losses of the sensors", 0, ge=0)
    one_step: bool = option("one run alone, in a third of the time: the last digits depend on the step", False)
    samples: bool = option("with --json: include every sample, as columns", False)
    everything: Everything = False
    as_csv: Csv = False


class AnalyseVerb(Verb, answer="analyse:analyse_machine"):
    """Analyse one position or one cycle: kinematics, forces and machine constants."""

    rules: ClassVar[Rules] = (Excludes("crank_deg", "cycle", "one position or one cycle"),)
    machine: MachineName
    crank_deg: float | None = option("crank angle, degrees")
    cycle: int | None = option("positions over one cycle", ge=2, le=1_000_000)
    config: Config = None
    settings: Settings = []
    wide: Wide = False
    as_csv: Csv = False
    as_json: Json = False


ON_TOPICS = ("rate", "start_s", "duration_s", "loop", "clock", "topics", "listeners", "namespace")
RECOMPUTING = ("analyse", "resimulate")


class ReplayVerb(Verb, answer="recording:replay"):
    """Replay a recording on its topics, or recompute it and compare bit for bit (exit code 1: different)."""

    rules: ClassVar[Rules] = (
        Excludes("analyse", "resimulate", "forces alone, or the whole run"),
        *(
            Excludes(mode, each, "the recording is read at once, nothing is published")
            for mode in RECOMPUTING
            for each in ON_TOPICS
        ),
        Requires("given_map", ("analyse",), "a measured run has no topics of the twin"),
        Requires("tolerance", ("analyse",), "a run computed again from its start keeps no small error"),
        Requires("config", RECOMPUTING, "a replay needs no configuration"),
        Requires("as_json", RECOMPUTING, "a replay has no result to print"),
    )
    bag: BagOrTable
    rate: float = option("playback rate: recorded seconds per second", 1.0)
    start_s: float = option("start time within the recording, s", 0.0, unit="s")
    duration_s: float | None = option("duration to replay, s", unit="s")
    loop: bool = option("repeat until stopped", False)
    clock: bool = option("publish /clock from the playback time", False)
    topics: list[str] = option("only these topics", [], metavar="T...")
    listeners: int = option("subscribers to wait for on each topic", 0, ge=0)
    namespace: Namespace = None
    analyse: bool = option("recompute the forces from the recorded motion and compare", False)
    resimulate: bool = option("recompute the whole run and compare", False)
    given_map: MapFile = None
    config: Config = None
    tolerance: float | None = option("with --analyse: allowed relative difference from the model", ge=0.0)
    as_json: Json = False


class ViewVerb(Verb, answer="view:view_bag"):
    """Show a recording, or a run of a page, in the viewer; with a map, the mechanism in a measured motion."""

    rules: ClassVar[Rules] = (
        Excludes("save", "port", "a file has no page"),
        Requires("config", ("given_map",), "a recording holds its own configuration"),
        Excludes("duration_s", "given_map", "a measurement has its own length"),
    )
    bag: BagOrTable
    given_map: MapFile = None
    config: Config = None
    duration_s: float | None = option("of a page: time to simulate, s (3, 500ms)", unit="s", shown="3")
    save: Path | None = option("write a file NAME.rrd instead of opening the view", writes=(".rrd",))
    port: Port = 0
    force: Force = False


class InfoVerb(Verb, answer="recording:show_info"):
    """Describe a recording: what, how long, whether complete; with a map, a measurement's channels."""

    rules: ClassVar[Rules] = (
        Excludes("given_map", "as_csv", "the quality of channels is a table for people, or --json"),
        Excludes("given_map", "wide", "the quality of channels has one table"),
        Excludes("given_map", "verify", "a map reads every message of its channels"),
        Requires("config", ("given_map",), "a recording holds its own configuration"),
    )
    bag: BagOrTable
    given_map: MapFile = None
    config: Config = None
    verify: bool = option("read every chunk and its checksum (exit code 1: damage)", False)
    wide: bool = option("all columns, whatever the width of the terminal", False)
    as_csv: bool = option("print the table of topics as CSV", False, "--csv")
    as_json: Json = False


class CompareVerb(Written, answer="compare:compare_sides"):
    """Compare two recordings or configurations (exit code 1: a number differs by more than the tolerance)."""

    rules: ClassVar[Rules] = (Requires("column", ("picture",), "columns are those of the picture"),)
    first: str = argument("recording, configuration file (.yaml) or machine", metavar="A")
    second: str = argument("what to compare it with, of the same machine", metavar="B")
    tolerance: float = option("allowed relative difference", 0.0, ge=0.0, le=1.0)
    duration_s: float | None = option(
        "time to simulate a configuration, s", unit="s", shown="that of the recording, else 3"
    )
    picture: Path | None = option("picture (.png or .svg) of what differs", writes=(".png", ".svg"), extra="plots")
    column: list[str] = option("column in the picture, again for more", [], shown="what differs most")
    view: Literal["web", "none"] = option("web: both in one view on the bench", "none")
    view_port: Port = 0
    everything: bool = option("all numbers, not only those that differ", False, "--all")


class BenchVerb(Verb, answer="live_view:open_bench"):
    """Open the bench without a run: machines and pages to run, recordings to open, two of them in one view."""

    folder: Path = argument("directory of recordings and of pages of your own", Path())
    port: Port = 0


class FoxgloveVerb(Verb, answer="run:serve_foxglove"):
    """Serve a running machine to Foxglove: topics, and with --commands its live parameters and services."""

    target: str = argument("machine, or namespace of its nodes", metavar="TARGET")
    port: int = option("port, on this host alone; 0: any free port", 8765, ge=0, le=65535)
    commands: bool = option("let clients set live parameters and call services", False)


class TellVerb(Verb, answer="run:tell_nodes"):
    """Tell a running machine to start, stop or change, its monitor to be quiet, its advisor yes or no."""

    target: str = argument("machine, or namespace of its nodes", metavar="TARGET")
    what: list[str] = argument(
        "start, stop, reset; step (of a paused run); snapshot (of a recorder); acknowledge, shelve (a fault); "
        "accept, reject (an advice); identify, take-over (of a shadow with --identify); "
        "pause, resume (a run or a replay), next-impact (a replay); "
        "or live parameters and their values, or motor.command=SHARE of the rated speed",
        metavar="ORDER|KEY=VALUE",
    )
    fault: str | None = option("fault that is acknowledged or shelved; all without")
    wait_s: float = option("time to find the nodes, s", 5.0, unit="s", shown="5")


class RecoverVerb(Written, answer="recording:recover_bag"):
    """Salvage a damaged recording: write its intact part into a new one."""

    bag: Path = argument("recording: a directory, or one .mcap file")
    out: Path = argument("directory of the new recording")


class ReproduceVerb(Configured, answer="reproduce:reproduce_machines"):
    """Compare every published number with the computed one; draw the published figures."""

    machine: str | None = argument("machine, or the beginning of its name; all if absent", None, complete="machines")
    figures: Path | None = option("directory for the figures of the sources")
    wide: Wide = False
    as_csv: bool = option("every column as CSV", False, "--csv")


class NewVerb(Verb, answer="machines:write_page"):
    """Write a page to start from: a planar machine of one's own."""

    kind: str | None = argument("page to start from; names them where absent", None)
    keys: str | None = option("keys of a group of pages, such as springs; all: of all groups", metavar="GROUP")


class CheckVerb(Written, answer="machines:check_page"):
    """Check a page: freedoms, loops, masses, contacts and the pose at the start."""

    page: str = argument("page (.yaml)", metavar="PAGE")
    picture: Path | None = option("picture (.png or .svg) of the machine at its start", writes=(".png", ".svg"))


class FmuVerb(Configured, answer="machines:export_unit"):
    """Export a machine as a functional mock-up unit (FMI 2.0 or 3.0, co-simulation) that needs no Python."""

    machine: MachineName
    fmi: int = option("version of the standard: 2 or 3", 2, ge=2, le=3)
    windows: bool = option("for 64-bit Windows as well as for Linux", False)
    out: Path | None = option("file to write", shown="MACHINE.fmu")
