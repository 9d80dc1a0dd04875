# SPDX-License-Identifier: Apache-2.0
"""Errors of the view, in a module of their own that does not need rerun."""

from __future__ import annotations


class RerunSceneError(RuntimeError):
    """The view cannot show the run or write its file; the message is one line."""


class ViewerError(RuntimeError):
    """The page cannot be served; the message is one line."""
