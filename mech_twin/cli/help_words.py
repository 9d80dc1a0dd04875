# SPDX-License-Identifier: Apache-2.0
"""How ``--help`` names what an option takes, N, PATH, TEXT, and how a verb reads its words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from typer.core import TyperCommand

from mech_twin.cli.option_rules import check_options
from mech_twin.cli.usage_errors import own_words, refuse_options_as_values

PLACEHOLDERS = {"integer": "N", "int": "N", "float": "NUMBER", "path": "PATH"}
OF_THE_LIBRARY = {
    "help": "show this help",
    "install_completion": "install completion for the current shell",
    "show_completion": "show the completion script of the current shell, to copy or change it",
}


class Verb(TyperCommand):
    """A command whose help and errors are in the words of the field; options that contradict each other are refused."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters with a placeholder each."""
        return named(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words after the verb."""
        typed = tuple(args)
        if ctx.resilient_parsing:  # of a line that is still being written
            return super().parse_args(ctx, args)
        refuse_options_as_values(self.get_params(ctx), typed)
        with own_words(ctx, typed):
            rest = super().parse_args(ctx, args)
        check_options(ctx)
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
