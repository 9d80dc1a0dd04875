# SPDX-License-Identifier: Apache-2.0
"""The machines the contract tests run over, each built from its installed configuration."""

from __future__ import annotations

from functools import cache
from pathlib import Path

from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine
from mech_twin.roles import Machine

NAMES = tuple(CATALOGUE)
PAGES = tuple(map(str, sorted(Path(__file__).resolve().parents[1].joinpath("config", "pages").glob("*.yaml"))))
WITH_BODY = tuple(name for name, entry in CATALOGUE.items() if entry.has_body)


@cache
def built(name: str) -> Machine:
    """Return the machine as installed."""
    return machine(name)
