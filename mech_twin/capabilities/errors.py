# SPDX-License-Identifier: Apache-2.0
"""Errors of a study that cannot be carried out as requested."""

from __future__ import annotations


class StudyError(ValueError):
    """An error in the request; the message is one line for the user."""


class UnknownNameError(StudyError, KeyError):
    """An unknown name; the message lists similar ones."""

    def __str__(self) -> str:  # KeyError would quote the message
        return str(self.args[0])
