# SPDX-License-Identifier: Apache-2.0
"""What a strain gauge on a struck rod tells of an impact: numbers by name, and its curve over time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import nan
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.samples import Event

# what a gauge tells of an impact, with the SI unit: energies of the first compressive wave, of all
# that goes forward and all that comes back, largest compression, its strain, largest tension
GAUGE_UNITS: Mapping[str, str] = MappingProxyType(
    {
        "incident_energy": "J",
        "forward_energy": "J",
        "reflected_energy": "J",
        "peak_force": "N",
        "peak_strain": "1",
        "peak_tension": "N",
    }
)


class GaugeCurve(NamedTuple):
    """Force (N) and strain at a gauge, compression positive, ``span_s`` apart, the first after the first span."""

    span_s: float
    force_n: NDArray[np.float64]
    strain: NDArray[np.float64]


class BlowGauge(NamedTuple):
    """The gauge of a machine: of which impacts it tells, what, and its curve; ``sends_curve`` where that is asked for.

    ``numbers`` are those of `GAUGE_UNITS`, in their order.
    """

    kind: str
    contact: str
    numbers: Callable[[Event], tuple[float, ...]]
    curve: Callable[[Event], GaugeCurve]
    sends_curve: bool

    def tells(self, event: Event) -> bool:
        """Return whether it tells of an event."""
        return event.kind == self.kind and event.contact == self.contact and event.impulse_ns > 0.0

    def number(self, event: Event, name: str) -> float:
        """Return a number of an event by its name; nan of one it does not tell of."""
        return self.numbers(event)[tuple(GAUGE_UNITS).index(name)] if self.tells(event) else nan
