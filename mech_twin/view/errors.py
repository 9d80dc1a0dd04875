# SPDX-License-Identifier: Apache-2.0
"""What the view cannot do; apart from the scene, so that it can be named where rerun is not installed."""

from __future__ import annotations


class RerunSceneError(RuntimeError):
    """The view cannot show or keep the run; the message is one line."""


class ViewerError(RuntimeError):
    """The page cannot be served; the message is one line."""
