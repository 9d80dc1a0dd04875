# SPDX-License-Identifier: Apache-2.0
"""A motion that cannot be computed."""

from __future__ import annotations


class MotionError(ArithmeticError):
    """A step that no integration is short enough for, or with more events than are followed; one line for the user."""


class StateError(ValueError):
    """A text that is no state of a machine, or a state that cannot be offered; one line for the user."""
