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
    option, follows = "", False
    for argument in arguments:
        if argument.startswith("-"):
            option = argument if argument in MULTIPLE else ""
            follows = bool(option)
        elif option and not follows:
            given.append(option)
        else:
            follows = False
        given.append(argument)
    return given
