# SPDX-License-Identifier: Apache-2.0
"""Errors of measurements: the file, the fault and what was expected, in one line."""

from __future__ import annotations

from pathlib import Path


class MeasurementError(Exception):
    """An unusable measurement; the message is one line for the user."""

    def __init__(self, file: Path | str, reason: str) -> None:
        self.file = Path(file)
        self.reason = " ".join(reason.split())
        super().__init__(f"{self.file}: {self.reason}")
