# SPDX-License-Identifier: Apache-2.0
"""Options that accept several values: ``--topics A B C``."""

from __future__ import annotations

from typing import Any

from mech_twin.cli.help_words import Verb

MULTIPLE = ("--topics",)


class ManyValues(Verb):
    """A command whose `MULTIPLE` options may be followed by several values."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments after repeating the option for each further value."""
        return super().parse_args(ctx, expanded(args))


def expanded(arguments: list[str]) -> list[str]:
    """Return the arguments with the option repeated before each of its values."""
    given: list[str] = []
    option: str | None = None
    for argument in arguments:
        if argument.startswith("-"):
            option = argument if argument in MULTIPLE else None
            if option is None:
                given.append(argument)
        elif option is not None:
            given += [option, argument]
        else:
            given.append(argument)
    return given + ([option] if option and given[-2:-1] != [option] else [])
