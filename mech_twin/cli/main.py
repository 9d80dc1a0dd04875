# SPDX-License-Identifier: Apache-2.0
"""The ``mech-twin`` command, made of its verbs; each is declared once and answered in a file of its own."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from mech_twin import __version__
from mech_twin.cli import measurement_verbs, study_verbs, verbs
from mech_twin.cli.command_group import CommandGroup, QuestionGroup, VerbCommand
from mech_twin.cli.console import compiling_shown
from mech_twin.cli.failure import INTERRUPTED, CommandError, report_cli_errors
from mech_twin.cli.verb import command, in_library, verbs_in
from mech_twin.process.interruption import EXIT_CODE_BASE, end_at_once
from mech_twin.process.system_limits import NUMERICS_BYTES, check_address_space

VERBS = verbs_in(verbs, measurement_verbs)
QUESTIONS = verbs_in(study_verbs)
EXPORTS = {"fmu": VERBS.pop("fmu")}
MACHINE = in_library("machine", VERBS["simulate"].model_fields["machine"])

app = typer.Typer(
    name="mech-twin",
    cls=CommandGroup,
    help="Digital twin of percussion and crank-linkage machines.",
    no_args_is_help=False,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    pretty_exceptions_enable=False,
)
study_app = typer.Typer(
    cls=QuestionGroup,
    subcommand_metavar="QUESTION [OPTIONS]...",
    help="Sweep, size or optimise a machine: mech-twin study MACHINE QUESTION.",
)
export_app = typer.Typer(cls=CommandGroup, help="Export a machine for other tools: mech-twin export fmu MACHINE.")


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


@study_app.callback(invoke_without_command=True)
def study(context: typer.Context, machine: str = MACHINE) -> None:
    """Sweep, size or optimise a machine."""
    context.obj = machine
    if context.invoked_subcommand is None:
        from mech_twin.studies.asking import questions_of

        raise CommandError(f"study {machine}: name a question after the machine: {', '.join(questions_of(machine))}")


for group, members in ((app, VERBS), (study_app, QUESTIONS), (export_app, EXPORTS)):
    for word, verb in members.items():
        group.command(word, cls=VerbCommand)(command(verb))
app.add_typer(study_app, name="study")
app.add_typer(export_app, name="export")


def main() -> None:
    """Run the command line."""
    try:
        with report_cli_errors(), compiling_shown():
            check_address_space(NUMERICS_BYTES, "the numerical libraries take")
            code = app(prog_name="mech-twin", standalone_mode=False)
            if code == INTERRUPTED:  # the command line library turns KeyboardInterrupt into this code
                raise KeyboardInterrupt
            sys.stdout.flush()
    except SystemExit as end:
        if isinstance(end.code, int) and end.code > EXIT_CODE_BASE:
            end_at_once(end.code)
        raise
    raise SystemExit(code if isinstance(code, int) else 0)
