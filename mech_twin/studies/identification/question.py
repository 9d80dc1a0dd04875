# SPDX-License-Identifier: Apache-2.0
"""Specification of an identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mech_twin.declarations.quantity import Parameters


@dataclass(frozen=True)
class IdentificationQuestion:
    """Specification of a fit: machine, free keys, and what is known of them.

    Attributes
    ----------
    machine : str
        Machine of the catalogue.
    base : Parameters
        Configuration to start from; keys that are not estimated keep its values.
    keys : tuple of str
        Keys that may change.
    bounds : mapping
        Lower and upper bounds of some keys.
    priors : mapping
        Mean and standard deviation of some keys.
    longest_begin_s : float
        Latest start of a run whose start is unknown, as time since the machine's start.
    seed : int
        Seed of the random further starts.
    cores : int, optional
        Threads; all cores if absent.
    scheduler : str, optional
        Address of a Dask scheduler that distributes starts and profiles.
    """

    machine: str
    base: Parameters
    keys: tuple[str, ...]
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    longest_begin_s: float = 0.0
    seed: int = 0
    cores: int | None = None
    scheduler: str | None = None
