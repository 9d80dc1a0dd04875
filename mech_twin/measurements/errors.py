# SPDX-License-Identifier: Apache-2.0
"""Errors of measurements: the file, what is wrong in it and what was expected, in one line."""

from __future__ import annotations

from pathlib import Path


class MeasurementError(Exception):
    """A measurement that cannot be used; the message is one line for the user."""

    def __init__(self, file: Path | str, reason: str) -> None:
        self.file = Path(file)
        self.reason = " ".join(reason.split())
        super().__init__(f"{self.file}: {self.reason}")
