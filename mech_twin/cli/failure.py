"""How a command fails: one line on standard error, exit code 2."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from mech_twin.dependencies import missing_extra

EXIT_CODE = 2


class CommandError(Exception):
    """A command that cannot be carried out as asked; the message is one line."""


@contextmanager
def told_in_one_line() -> Iterator[None]:
    """Turn an error that is the input's into one line and exit code 2; anything else is ours and keeps its trace."""
    try:
        yield
    except Exception as error:
        if not _is_about_input(error):
            raise
        sys.stderr.write(f"mech-twin: {' '.join(_message(error).split())}\n")
        raise SystemExit(EXIT_CODE) from error


def _message(error: Exception) -> str:
    if isinstance(error, ImportError):
        return missing_extra(error) or str(error)
    told = getattr(error, "format_message", None)  # the command line library words its own errors
    return str(told() if told else error)


def _is_about_input(error: Exception) -> bool:
    if isinstance(error, ImportError):
        return missing_extra(error) is not None
    from typer.exceptions import TyperException

    from mech_twin.nodes.errors import NodeEndedError
    from mech_twin.parameters.errors import ConfigurationError
    from mech_twin.recording.errors import BagError
    from mech_twin.view.errors import StageError
    from mech_twin.view.viewer_process import ViewerError

    kinds = (CommandError, TyperException, NodeEndedError, ConfigurationError, BagError, StageError, ViewerError)
    return isinstance(error, kinds)
