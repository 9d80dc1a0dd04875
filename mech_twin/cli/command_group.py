# SPDX-License-Identifier: Apache-2.0
"""What every verb understands on the command line: several values after one option, names and orders that are meant."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

from typer.core import TyperGroup

from mech_twin.cli.failure import CommandError
from mech_twin.cli.help_words import named
from mech_twin.cli.usage_errors import own_words

ASSIGNING = ("--set", "--over", "--limit", "--bound", "--change")  # each value has an = in it


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


def with_options_repeated(arguments: list[str]) -> list[str]:
    """Return the arguments with an option of assignments repeated: ``--set a=1 b=2`` as ``--set a=1 --set b=2``."""
    given: list[str] = []
    option, follows = "", False
    for argument in arguments:
        if argument.startswith("-") and not follows:
            option = argument if argument in ASSIGNING else ""
            follows = bool(option)
        elif follows:
            follows = False
        elif option and "=" in argument:
            given.append(option)
        else:
            option = ""
        given.append(argument)
    return given
