# SPDX-License-Identifier: Apache-2.0
"""A study that cannot be carried out as asked."""

from __future__ import annotations


class StudyError(ValueError):
    """What is wrong with the question; the message is one line for the user."""


class UnknownNameError(StudyError, KeyError):
    """A name that is none of those there are; the message says which are near."""

    def __str__(self) -> str:  # that of a KeyError is quoted
        return str(self.args[0])
