# SPDX-License-Identifier: Apache-2.0
"""A study that cannot be carried out as asked."""

from __future__ import annotations


class StudyError(ValueError):
    """What is wrong with the question; the message is one line for the user."""
