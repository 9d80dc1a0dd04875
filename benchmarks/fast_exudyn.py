# SPDX-License-Identifier: Apache-2.0
"""Exudyn in its build without range checks, which a flag chooses before the first import."""

import sys

sys.exudynFast = True  # type: ignore[attr-defined]

import exudyn  # noqa: E402 - reads the flag

__all__ = ["exudyn"]
