# SPDX-License-Identifier: Apache-2.0
"""The questions of ``mech-twin study MACHINE QUESTION``: each a model of its options."""

from pathlib import Path
from typing import Annotated, ClassVar

from mech_twin.cli.verb import Excludes, Rules, option
from mech_twin.cli.verbs import Configured, Csv
from mech_twin.files.output_file import YAML_SUFFIXES

Everything = Annotated[bool, option("every row and column", False, "--all")]
Cores = Annotated[int | None, option("processor cores to use, a process each", ge=1, le=1024, shown="all cores")]
Scheduler = Annotated[str | None, option("Dask scheduler, tcp://HOST:PORT", metavar="ADDRESS")]
Seed = Annotated[int, option("seed of the random draws; the same seed gives the same answer", 1, ge=0)]
Limits = Annotated[
    list[str],
    option(
        "limits that replace the usual ones, SI units; `--limit help` lists them",
        [],
        metavar="NAME=VALUE...",
        complete="limits",
    ),
]
Bounds = Annotated[
    list[str],
    option(
        "bounds that replace the usual ones of design variables, SI units",
        [],
        metavar="NAME=LOW:HIGH...",
        complete="bounds",
    ),
]
HELP = "help"  # in place of a limit
PICTURES = (".png", ".svg", ".pdf")
SPREAD = Excludes("cores", "scheduler", "processes here, or workers of a cluster")


class Study(Configured):
    """A question about a machine, whose name stands before it."""

    machine: str
    report: Path | None = option("report to write, one page that prints well (NAME.html)", writes=(".html",))

    def check_outputs(self) -> None:
        """Raise where a file could not be written, unless the limits are asked for alone."""
        if HELP not in getattr(self, "limit", ()):
            super().check_outputs()

    @property
    def output(self) -> Path:
        """The file that is written: as asked, else the usual one of the machine."""
        path = self.written_to("out")
        assert path is not None
        return path


class SweepVerb(Study, answer="study_answers:answer_sweep"):
    """Sweep configuration keys over a grid; resume an interrupted sweep."""

    rules: ClassVar[Rules] = (SPREAD,)
    over: list[str] = option(
        "from:to:count, from:to:count:log, or a,b,c; several keys make a grid",
        ...,
        metavar="KEY=VALUES...",
        complete="settings",
    )
    out: Path | None = option(
        "table to write, NAME.parquet or NAME.csv", writes=(".parquet", ".csv"), usual="sweep.parquet"
    )
    number: list[str] = option("number to tabulate; may be given several times", [], metavar="NAME", shown="all")
    duration_s: float = option("time to simulate at each point, s (3, 500ms); 0: the analysis alone", 0.0, unit="s")
    no_picture: bool = option("write the table alone", False)
    cores: Cores = None
    scheduler: Scheduler = None
    everything: Everything = False
    as_csv: Csv = False


class SizeVerb(Study, answer="study_answers:answer_size"):
    """Size spring and preload, flywheel, counterweight, or motor and drive; say which constraint binds."""

    out: Path | None = option("configuration to write", writes=YAML_SUFFIXES, usual="sized.yaml")
    objective: str | None = option(
        "quantity to minimise, or what is to be made large",
        metavar="NAME",
        shown="the usual one of the machine",
        complete="objectives",
    )
    limit: Limits = []
    tolerance: float | None = option(
        "relative tolerance of each assumed value within which limits are tried", shown="the usual one of the machine"
    )


class SearchVerb(Study, answer="study_answers:answer_search"):
    """Choose a machine's dimensions: scan, then optimise; a Pareto front for several objectives; or by runs."""

    objective: list[str] = option(
        "quantity to minimise; several give a Pareto front; by runs any number, large with - before it",
        [],
        metavar="NAME",
        shown="the usual one of the machine",
        complete="objectives",
    )
    bound: Bounds = []
    limit: Limits = []
    seed: Seed = 1
    points: int | None = option("points of a Pareto front", ge=1, le=1000, shown="9")
    duration_s: float | None = option(
        "by runs: time to simulate each design, s; 0: the analysis alone", unit="s", ge=0.0
    )
    cores: int | None = option("by runs: processor cores to use", ge=1, le=1024, shown="all cores")
    out: Path | None = option("configuration to write", writes=YAML_SUFFIXES, usual="found.yaml")


class DesignsVerb(Study, answer="study_answers:answer_designs"):
    """Evaluate random designs of a machine, a million or more."""

    rules: ClassVar[Rules] = (SPREAD,)
    count: int = option("random designs to evaluate", 1_000_000, ge=1, le=1_000_000_000)
    bound: Bounds = []
    limit: Limits = []
    seed: Seed = 1
    out: Path | None = option("Parquet file of the feasible designs", writes=(".parquet",), extra="tables")
    cores: Cores = None
    scheduler: Scheduler = None


class SynthesiseVerb(Study, answer="study_answers:answer_synthesise"):
    """Synthesise a one-impact cycle as published, and a robust one beside it."""

    impact_speed_m_per_s: float = option("target impact speed, m/s", 20.0, "--impact-speed")
    margin: float = option("stability margin: least 1 - |largest multiplier|", 0.1)
    basin_fraction: float = option(
        "basin of attraction: least share of random starts that reach the cycle", 0.999, "--basin"
    )
    tolerance: float = option("relative tolerance of P1, P2, t1, T and R within which the cycle is tried", 0.01)
    stroke_ratio: float = option("upper limit of the largest gap over the stroke", 2.5)
    starts: int = option("random starts that test the basin, at most 1000000", 1000, ge=1)
    seed: Seed = 1
    periods: int = option("length of the endurance runs in periods, at most 1000000000", 1_000_000, ge=1)
    out: Path | None = option("robust configuration to write", writes=YAML_SUFFIXES, usual="robust.yaml")


class RegimesVerb(Study, answer="study_answers:answer_regimes"):
    """Map the long-run regimes of a machine over one key; draw the bifurcation diagram."""

    over: list[str] = option(
        "one key and its values: from:to:count, from:to:count:log, or a,b,c",
        ...,
        metavar="KEY=VALUES",
        complete="settings",
    )
    settling: int = option("settling periods left out, at most 100000", 1000, ge=1)
    out: Path | None = option(
        "bifurcation diagram to write (.png, .svg, .pdf)", writes=PICTURES, usual="regimes.png", extra="plots"
    )
    everything: Everything = False
    as_csv: Csv = False
