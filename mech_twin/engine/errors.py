# SPDX-License-Identifier: Apache-2.0
"""Errors of a motion that cannot be computed, and of a state that cannot be stored or restored."""

from __future__ import annotations


class MotionError(ArithmeticError):
    """A step for which the integration fails or which has too many events; one line for the user."""


class StateError(ValueError):
    """A text that is no state of a machine, or a state that cannot be stored; one line for the user."""
