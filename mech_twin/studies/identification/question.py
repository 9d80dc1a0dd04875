# SPDX-License-Identifier: Apache-2.0
"""What is asked of an identification."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mech_twin.declarations.quantity import Parameters


@dataclass(frozen=True)
class IdentificationQuestion:
    """What is asked of a fit.

    Attributes
    ----------
    machine : str
        Machine of the catalogue.
    base : Parameters
        Configuration to start from; keys that are not found keep its values.
    keys : tuple of str
        Keys that may change.
    bounds : mapping
        Least and largest value of some of them.
    priors : mapping
        Mean and standard deviation of some of them.
    longest_begin_s : float
        Latest beginning of a run of unknown beginning, in the machine's own run.
    seed : int
        Of further starts.
    cores : int, optional
        Threads; all cores if absent.
    scheduler : str, optional
        Address of a Dask scheduler, over which starts and profiles are spread.
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
