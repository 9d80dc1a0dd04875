"""What the view cannot do; apart from the stage, so that it can be named where rerun is not installed."""

from __future__ import annotations


class StageError(RuntimeError):
    """The stage cannot show or keep the run; the message is one line."""
