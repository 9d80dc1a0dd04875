# SPDX-License-Identifier: Apache-2.0
"""Options and arguments that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mech_twin.cli import completion
from mech_twin.cli.option_values import machine_name

MachineName = Annotated[
    str,
    typer.Argument(
        help="machine, or the beginning of its name (see `mech-twin list`)",
        callback=machine_name,
        autocompletion=completion.machines,
    ),
]
Config = Annotated[Path | None, typer.Option("--config", help="configuration file instead of the installed one")]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE...",
        help="override configuration keys, such as body.spring_rate_n_per_m=4e4",
        autocompletion=completion.settings,
    ),
]
Namespace = Annotated[
    str | None, typer.Option(metavar="NAME", help="namespace of the nodes instead of the machine's name")
]
Bag = Annotated[Path, typer.Argument(help="recording: a directory, or one .mcap file")]
BagOrTable = Annotated[
    Path,
    typer.Argument(
        metavar="BAG", help="recording: a directory, or one .mcap file; with --map also a table (.csv, .tsv, .parquet)"
    ),
]
MapFile = Annotated[
    Path | None, typer.Option("--map", help="map of a measurement: which channel is what (see `mech-twin map`)")
]
Force = Annotated[bool, typer.Option("--force", help="overwrite existing results")]
Json = Annotated[bool, typer.Option("--json", help="print JSON to standard output")]
Everything = Annotated[bool, typer.Option("--all", help="every number and event, not only the headlines")]
Csv = Annotated[bool, typer.Option("--csv", help="print comma-separated values")]
Wide = Annotated[bool, typer.Option("--wide", help="every column, whatever the width of the terminal")]
