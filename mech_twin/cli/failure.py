"""How a command fails: one line on standard error, exit code 2."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

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
        sys.stderr.write(f"mech-twin: {' '.join(str(error).split())}\n")
        raise SystemExit(EXIT_CODE) from error


def _is_about_input(error: Exception) -> bool:
    from mech_twin.parameters.errors import ConfigurationError
    from mech_twin.recording.errors import BagError
    from mech_twin.view.viewer_process import ViewerError

    return isinstance(error, CommandError | ConfigurationError | BagError | ViewerError)
