# SPDX-License-Identifier: Apache-2.0
"""Strain gauge on a struck rod: numbers of an impact by name, and its curve over time; blows apart from bounces."""

from collections import deque
from collections.abc import Callable, Iterator, Mapping
from math import degrees, nan, radians
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.samples import Event

# numbers of an impact with their SI units: energies of the first compressive wave, of all forward
# waves and of all reflected waves, largest compression, its strain, largest tension
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

RIGID_TURN_RAD = radians(2.0)  # crank rotation within a blow above which the striker's equivalent mass is not constant
RIGID_SHARE = 0.02  # relative change of the striker's mass that is allowed within a blow
ROUNDED = 1e-3  # relative rounding of a length above which it is reported
CLOSES = 1e-9  # m/s: a contact that closes no faster is closed, and passes on what strikes the body on it
RECENT_S = 2.0  # time by whose impacts bounces are judged
WEAK_SHARE = 0.25  # least energy relative to that of recent impacts, half their impulse: weaker ones are bounces


class GaugeCurve(NamedTuple):
    """Force (N) and strain at a gauge, compression positive, sampled every ``span_s``, first at ``span_s``."""

    span_s: float
    force_n: NDArray[np.float64]
    strain: NDArray[np.float64]


class BlowGauge(NamedTuple):
    """Gauge of a machine: kind and contacts of its impacts, numbers, curve; ``sent``: contacts whose curve is sent.

    ``numbers`` are those of `GAUGE_UNITS`, in their order.
    """

    kind: str
    contacts: tuple[str, ...]
    numbers: Callable[[Event], tuple[float, ...]]
    curve: Callable[[Event], GaugeCurve]
    sent: tuple[str, ...]

    def has_reading(self, event: Event) -> bool:
        """Return whether the gauge has a reading of an event."""
        struck = event.impulse_ns > 0.0 and event.pre_velocity_m_per_s > CLOSES
        return struck and event.kind == self.kind and event.contact in self.contacts

    def number(self, event: Event, name: str) -> float:
        """Return a number of an event by its name; nan for an event without a reading."""
        return self.numbers(event)[tuple(GAUGE_UNITS).index(name)] if self.has_reading(event) else nan


class RecentBlows:
    """Impacts of the recent time (s) with their energies (J), blows apart from bounces."""

    def __init__(self) -> None:
        self._hits: deque[tuple[float, float]] = deque()

    def is_blow(self, time_s: float, energy_j: float) -> bool:
        """Take an impact; return whether it is a blow, not a bounce."""
        self._hits.append((time_s, energy_j))
        self.forget(time_s)
        return energy_j > self._bounce_j()

    def forget(self, now_s: float) -> None:
        """Forget what is not recent."""
        while self._hits and self._hits[0][0] < now_s - RECENT_S:
            self._hits.popleft()

    def times_s(self) -> list[float]:
        """Return the times of the recent blows."""
        most_j = self._bounce_j()
        return [time_s for time_s, energy_j in self._hits if energy_j > most_j]

    def _bounce_j(self) -> float:
        """Return the most energy (J) of a bounce, by a mean that bounces hardly lower and a hard blow hardly lifts."""
        total_j = sum(energy_j for _, energy_j in self._hits)
        return WEAK_SHARE * sum(energy_j**2 for _, energy_j in self._hits) / total_j if total_j > 0.0 else 0.0


def blow_remarks(roundings: Mapping[str, tuple[float, float]], numbers: Mapping[str, float]) -> Iterator[str]:
    """Yield remarks on the validity of blows as waves: rounded lengths, a striker's mass that is not constant.

    Parameters
    ----------
    roundings : dict
        Configured length and the length on the grid (m), by key.
    """
    for key, (asked, taken) in roundings.items():
        if abs(taken - asked) > ROUNDED * asked:
            yield f"{key} = {asked:g} m is led as {taken:.6g} m, whole cells"
    for name, value in numbers.items():
        if name.endswith("turn_in_window_rad") and value > RIGID_TURN_RAD:
            yield (
                f"{name} = {value:.3g}: the mechanism turns {degrees(value):.2g} deg within a blow; above "
                f"{degrees(RIGID_TURN_RAD):g} deg its mass at the tool is not one number, and the blow is an estimate"
            )
        if name.endswith("striker_mass_change") and abs(value) > RIGID_SHARE:
            yield (
                f"{name} = {value:.3g}: the mechanism's mass at the contact changes within a blow; above "
                f"{RIGID_SHARE:g} it is not one number, and the blow is an estimate"
            )
        if name.endswith("head_too_heavy") and value > 0.0:
            yield f"{name} = {value:.3g}: blows whose head weighs nearly all of the striker, led without it"
        if name.endswith("striker_stopped_m_per_s") and value > 1e-9:
            yield f"{name} = {value:.3g}: the striker would go on after the rod, but is stopped at its contact"
        if name.endswith("impulses_without_wave"):
            yield f"{name} = {value:.3g}: blows on a body at rest on the rod, passed on as rigid; strike the rod itself"
        if name.endswith("blow_unended") and value > 0.0:
            yield f"{name} = {value:.3g}: blows longer than window_s (at most 0.02 s), ended there as plastic"
