# SPDX-License-Identifier: Apache-2.0
"""What every verb understands on the command line: several values after one option, names and orders that are meant."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

from typer.core import TyperCommand, TyperGroup

from mech_twin.cli.failure import CommandError
from mech_twin.cli.usage_errors import own_words, refuse_options_as_values
from mech_twin.cli.verb import check_rules

PLACEHOLDERS = {"integer": "N", "int": "N", "float": "NUMBER", "path": "PATH"}
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
        return named(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments after giving each ``KEY=VALUE`` of several its option."""
        typed = tuple(args)
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
    """A command whose help and errors are in the words of the field; options that contradict each other are refused."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters with a placeholder each."""
        return named(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words after the verb."""
        typed = tuple(args)
        if ctx.resilient_parsing:  # of a line that is still being written
            return super().parse_args(ctx, args)
        args = with_options_repeated(args)
        refuse_options_as_values(self.get_params(ctx), typed)
        with own_words(ctx, typed):
            rest = super().parse_args(ctx, args)
        check_rules(getattr(self.callback, "verb"), _given(ctx))  # noqa: B009 # as `command` sets it
        return rest


def named(parameters: Sequence[Any]) -> list[Any]:
    """Return the parameters of a command after giving each what stands for its value in the help."""
    for parameter in parameters:
        if parameter.param_type_name == "argument":
            parameter.metavar = parameter.metavar or parameter.name.upper()
            parameter.display_type_rich = _nothing  # the name of an argument says what it is
        elif getattr(parameter, "is_flag", False):
            parameter.metavar = ""
        elif parameter.metavar is None:
            parameter.metavar = _placeholder(parameter)
        parameter.help = OF_THE_LIBRARY.get(parameter.name, parameter.help)
    return list(parameters)


def _placeholder(parameter: Any) -> str:
    """Return what stands for the value of an option, by its type."""
    kind = getattr(getattr(parameter, "type_descriptor", None), "annotation", None)
    kinds = {getattr(one, "__name__", "").lower() for one in getattr(kind, "__args__", (kind,))}
    kinds.add(getattr(getattr(parameter, "type", None), "name", ""))  # where the library still has types of its own
    return next((word for name, word in PLACEHOLDERS.items() if name in kinds), "TEXT")


def _nothing(ctx: Any) -> str:
    return ""


def _given(context: Any) -> frozenset[str]:
    """Return the parameters that were typed, whatever their value."""
    sources = {name: context.get_parameter_source(name) for name in context.params}
    return frozenset(name for name, source in sources.items() if source is not None and source.name == "COMMANDLINE")


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
