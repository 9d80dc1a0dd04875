# SPDX-License-Identifier: Apache-2.0
"""The ``mech-twin`` command, made of its verbs: what each understands, and its errors in the words of all others."""

import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from itertools import pairwise
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from mech_twin import __version__
from mech_twin.cli import measurement_verbs, study_verbs, verbs
from mech_twin.cli.console import INTERRUPTED, CommandError, compiling_shown, report_cli_errors
from mech_twin.cli.verb import command, typer_parameter, verbs_in
from mech_twin.process.dependencies import NUMERICS_BYTES, check_address_space
from mech_twin.process.interruption import EXIT_CODE_BASE, end_at_once

OF_THE_LIBRARY = {
    "help": "show this help",
    "install_completion": "install completion for the current shell",
    "show_completion": "show the completion script of the current shell, to copy or change it",
}
ASSIGNING = ("--set", "--over", "--limit", "--bound", "--change")  # each value has an = in it
LISTING = ("--topics",)


class CommandGroup(TyperGroup):
    """The commands; an unknown one is answered with the near one, or with all."""

    entry = "command"

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters with a placeholder each."""
        return with_own_help(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments after giving each ``KEY=VALUE`` of several its option."""
        typed = tuple(args)
        if not (args or self.invoke_without_command or ctx.resilient_parsing):
            raise CommandError(f"{ctx.info_name}: expected a {self.entry} after it: {', '.join(self.commands)}")
        with own_words(ctx, typed):
            return super().parse_args(ctx, with_options_repeated(args))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that is named."""
        if args and not args[0].startswith("-") and self.get_command(ctx, args[0]) is None:
            near = get_close_matches(args[0], self.commands, 1)
            hint = f"; did you mean '{near[0]}'?" if near else f"; expected one of {', '.join(self.commands)}"
            raise CommandError(f"no {self.entry} '{args[0]}'{hint}")
        return super().resolve_command(ctx, args)


class QuestionGroup(CommandGroup):
    """The questions of ``study``, which may also stand before the machine."""

    entry = "question"

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments after setting the machine before the question."""
        if args and args[0] in self.commands:
            if len(args) == 1 or args[1].startswith("-"):
                raise CommandError(f"study {args[0]}: expected a machine before the question: study MACHINE {args[0]}")
            args = [args[1], args[0], *args[2:]]
        if not args and not ctx.resilient_parsing:
            raise CommandError(f"study: expected a machine and a question: study MACHINE {'|'.join(self.commands)}")
        return super().parse_args(ctx, args)


class VerbCommand(TyperCommand):
    """A command whose help and errors are in the words of the field."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters with a placeholder each."""
        return with_own_help(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words after the verb."""
        typed = tuple(args)
        if ctx.resilient_parsing:  # of a line that is still being written
            return super().parse_args(ctx, args)
        args = with_options_repeated(args)
        refuse_options_as_values(self.get_params(ctx), typed)
        with own_words(ctx, typed):
            return super().parse_args(ctx, args)


def with_own_help(parameters: Sequence[Any]) -> list[Any]:
    """Return the parameters of a command after taking what the library would add to them in the help."""
    for parameter in parameters:
        if parameter.param_type_name == "argument":
            parameter.display_type_rich = lambda ctx: ""  # the name of an argument says what it is
        elif getattr(parameter, "is_flag", False):
            parameter.metavar = ""
        parameter.help = OF_THE_LIBRARY.get(parameter.name, parameter.help)
    return list(parameters)


def with_options_repeated(arguments: list[str]) -> list[str]:
    """Return the arguments with an option repeated before each of its values: ``--set a=1 b=2``, ``--topics A B``."""
    given: list[str] = []
    option, follows = "", False
    for argument in arguments:
        if argument.startswith("-") and (not follows or option in LISTING):
            option = argument if argument in (*ASSIGNING, *LISTING) else ""
            follows = bool(option)
        elif follows:
            follows = False
        elif option in LISTING or (option and "=" in argument):
            given.append(option)
        else:
            option = ""
        given.append(argument)
    return given


UNEXPECTED = "Got unexpected extra argument"


@contextmanager
def own_words(context: Any, typed: Sequence[str]) -> Iterator[None]:
    """Turn an error of the command line library, in the words typed after a command's name, into one line of ours."""
    from typer.exceptions import TyperException

    try:
        yield
    except TyperException as error:
        raise CommandError(_line(error, context, typed)) from error


def refuse_options_as_values(parameters: Sequence[Any], typed: Sequence[str]) -> None:
    """Raise a CommandError where an option is followed by an option instead of its value."""
    options = _options(parameters)
    for word, following in pairwise(typed):
        option = options.get(word)
        if word == "--":
            return
        if option is None or getattr(option, "is_flag", False):
            continue
        if following in options or re.match(r"--\w", following):
            raise CommandError(f"{word} {following}: expected {_meaning(option)}, found an option")


def _line(error: Any, context: Any, typed: Sequence[str]) -> str:
    parameter, option = getattr(error, "param", None), getattr(error, "option_name", None)
    if option is not None and hasattr(error, "possibilities"):
        return _no_such_option(option, context)
    if option is not None:
        known = _options(context.command.get_params(context))[option]
        return f"{option} takes no value" if known.is_flag else f"missing value of {option}: expected {_meaning(known)}"
    if hasattr(error, "param_type") and parameter is not None:
        kind = "option " if parameter.param_type_name == "option" else ""
        return f"missing {kind}{_name(parameter)}: expected {parameter.help}"
    if str(error.message).startswith(UNEXPECTED):
        words = re.findall(r"\(([^()]*)\)$", error.message)
        usage = " ".join([_path(context), *_places(context), "[OPTIONS]"])
        return f"unexpected '{words[0] if words else ''}'; expected {usage}"
    return str(error.format_message())


def _no_such_option(option: str, context: Any) -> str:
    options = _options(context.command.get_params(context))
    longer = [name for name in options if name.startswith(option) and option.startswith("--")]
    near, where = longer or get_close_matches(option, options, 1), _path(context)
    hint = f"did you mean '{_name(options[near[0]], near[0])}'?" if near else f"`{where} --help` lists them"
    return f"no option '{option}' of {where}; {hint}"


def _options(parameters: Sequence[Any]) -> dict[str, Any]:
    """Return the options of a command by each of their names."""
    return {name: each for each in parameters if each.param_type_name == "option" for name in each.opts}


def _name(parameter: Any, name: str | None = None) -> str:
    """Return a parameter as the help has it: ``--duration TIME``, ``MACHINE``."""
    if parameter.param_type_name == "argument":
        return str(parameter.metavar)
    return f"{name or parameter.opts[0]} {parameter.metavar or ''}".strip()


def _meaning(option: Any) -> str:
    return f"{option.metavar} ({option.help})"


def _path(context: Any) -> str:
    """Return the command as it is typed: ``mech-twin study MACHINE sweep``."""
    if context.parent is None:
        return str(context.info_name)
    return " ".join([_path(context.parent), *_places(context.parent), context.info_name])


def _places(context: Any) -> list[str]:
    arguments = [each for each in context.command.get_params(context) if each.param_type_name == "argument"]
    return [each.metavar if each.required else f"[{each.metavar}]" for each in arguments]


VERBS = verbs_in(verbs, measurement_verbs)
QUESTIONS = verbs_in(study_verbs)
EXPORTS = {"fmu": VERBS.pop("fmu")}
MACHINE = typer_parameter("machine", VERBS["simulate"].model_fields["machine"])

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


def _show_version(shown: bool) -> None:
    if shown:
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
        from mech_twin.studies.declared_studies import questions_of

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
