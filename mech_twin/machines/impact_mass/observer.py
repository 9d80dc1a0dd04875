# SPDX-License-Identifier: Apache-2.0
"""Running metrics of a run of the impact mass."""

import math
from collections import deque
from collections.abc import Callable

from mech_twin.machines.impact_mass.dynamics import (
    CHATTER_END,
    IMPACT,
    IMPACTS_SUMMED,
    KIND_NAMES,
    RELEASE,
    STUCK_REGIME,
)
from mech_twin.machines.impact_mass.step import MassMemory
from mech_twin.samples import Event, Frame

STEADY_PERIODS = 20  # full periods with an impact over which the steady impact speed is taken
IMPACT_NAME, CHATTER_END_NAME, RELEASE_NAME, SUMMED_NAME = (
    KIND_NAMES[int(kind)] for kind in (IMPACT, CHATTER_END, RELEASE, IMPACTS_SUMMED)
)


class CompensatedSum:
    """A sum whose rounding does not grow with the number of terms (Neumaier)."""

    def __init__(self) -> None:
        self._sum = 0.0
        self._lost = 0.0

    def add(self, term: float) -> None:
        """Add a term."""
        total = self._sum + term
        if abs(self._sum) >= abs(term):
            self._lost += (self._sum - total) + term
        else:
            self._lost += (term - total) + self._sum
        self._sum = total

    @property
    def value(self) -> float:
        """The sum so far."""
        return self._sum + self._lost


class SteadySpeed:
    """Hardest impact of each of the last full periods; periods without an impact are left out."""

    def __init__(self) -> None:
        self._full: deque[float] = deque(maxlen=STEADY_PERIODS)
        self._period = -1
        self._hardest = 0.0

    def add(self, period: int, speed_m_per_s: float) -> None:
        """Update with an impact; one in a later period completes the period before."""
        if period != self._period:
            if self._period >= 0:
                self._full.append(self._hardest)
            self._period, self._hardest = period, 0.0
        self._hardest = max(self._hardest, speed_m_per_s)

    def numbers(self) -> dict[str, float]:
        """Return mean, spread (largest less least) and number of the periods it is taken over; 0 before the first."""
        count = len(self._full)
        return {
            "steady_impact_speed_m_per_s": sum(self._full) / count if count else 0.0,
            "steady_impact_speed_spread_m_per_s": max(self._full) - min(self._full) if count else 0.0,
            "steady_impact_periods": float(count),
        }


def counts(memory: MassMemory) -> dict[str, float]:
    """Return the mass's own counts of the run, by the metrics that they lead."""
    return {"impacts": memory.impacts_1, "periods": memory.anchor_period_1}


class MassObserver:
    """Running metrics of a run; the velocity's extremes lie at events, so they are exact.

    Parameters
    ----------
    stop_m : float
        Where the stop is.
    blow : callable, optional
        Results of a blow at a speed (m/s), for a stop that is a rod.
    """

    def __init__(self, stop_m: float, blow: Callable[[float], dict[str, float]] | None = None) -> None:
        self._stop, self._blow = stop_m, blow
        self._speed_sum = CompensatedSum()
        self._impulse = CompensatedSum()
        self._steady, self._begin_s = SteadySpeed(), math.nan
        self._work, self._loss, self._change = CompensatedSum(), CompensatedSum(), CompensatedSum()
        self._begin_j = self._last_j = 0.0  # kinetic energy
        self._before: dict[str, float] = {}
        self._numbers = {
            "impacts": 0.0,
            "chatter_ends": 0.0,
            "releases": 0.0,
            "periods": 0.0,
            "last_period_impacts": 0.0,
            "hardest_blow_m_per_s": 0.0,
            "last_blow_m_per_s": 0.0,
            "mean_blow_m_per_s": 0.0,
            "velocity_min_m_per_s": 0.0,
            "velocity_max_m_per_s": 0.0,
            "gap_max_m": 0.0,
            "stop_impulse_ns": 0.0,
            "mean_stop_force_n": 0.0,
            "rests_for_good": 0.0,
            "peak_contact_force_n": 0.0,
            "longest_contact_time_s": 0.0,
        }

    def observe(self, frame: Frame) -> None:
        """Update with one frame."""
        now, linkage = self._numbers, frame.linkage
        memory = MassMemory(*linkage.memory.values)
        (position,), (velocity,) = linkage.position, linkage.velocity
        self._last_j = 0.5 * memory.mass_kg * velocity**2
        if math.isnan(self._begin_s):  # a recording may begin within a run, its first sample at the end of a step
            self._begin_s, self._begin_j, self._before = linkage.time_s, self._last_j, counts(memory)
        else:
            self._take_step(linkage.events, memory)
            now["mean_stop_force_n"] = now["stop_impulse_ns"] / (linkage.time_s - self._begin_s)
        now["velocity_min_m_per_s"] = min(now["velocity_min_m_per_s"], velocity)
        now["velocity_max_m_per_s"] = max(now["velocity_max_m_per_s"], velocity)
        now["gap_max_m"] = max(now["gap_max_m"], self._stop - position)
        now["last_period_impacts"] = memory.last_period_impacts_1
        shown = frame.forces.quantities.as_dict()
        now["peak_contact_force_n"] = max(now["peak_contact_force_n"], shown["peak_contact_force_n"])
        now["longest_contact_time_s"] = max(now["longest_contact_time_s"], shown["contact_time_s"])
        self._take_rest(linkage.regime, linkage.time_s, memory)

    def _take_step(self, events: tuple[Event, ...], memory: MassMemory) -> None:
        """Take what happened since the sample before; counts are the mass's own, as a sum of impacts is one event."""
        counted = counts(memory)
        for name, count in counted.items():
            self._numbers[name] += count - self._before[name]
        self._before = counted
        for event in events:
            self._take_event(event, memory)
        self._impulse.add(memory.step_impulse_m_per_s * memory.mass_kg)
        self._numbers["stop_impulse_ns"] = self._impulse.value
        self._work.add(memory.step_drive_work_j)
        self._loss.add(memory.step_stop_loss_j)
        self._change.add(memory.step_change_work_j)

    def _take_event(self, event: Event, memory: MassMemory) -> None:
        now = self._numbers
        low, high = sorted((event.pre_velocity_m_per_s, event.post_velocity_m_per_s))
        now["velocity_min_m_per_s"] = min(now["velocity_min_m_per_s"], low)
        now["velocity_max_m_per_s"] = max(now["velocity_max_m_per_s"], high)
        if event.kind in (IMPACT_NAME, SUMMED_NAME):
            self._speed_sum.add(event.impulse_ns / (memory.mass_kg * (1.0 + memory.restitution_1)))
            self._steady.add(event.period, high)
            now["hardest_blow_m_per_s"] = max(now["hardest_blow_m_per_s"], high)
            now["last_blow_m_per_s"] = high
            now["mean_blow_m_per_s"] = self._speed_sum.value / now["impacts"]
            now["last_impact_time_s"] = event.time_s
        elif event.kind in (CHATTER_END_NAME, RELEASE_NAME):
            now[f"{event.kind}s"] += 1.0

    def _take_rest(self, regime: int, time_s: float, memory: MassMemory) -> None:
        now = self._numbers
        pressed = min(memory.phase1_acceleration_m_per_s2, memory.phase2_acceleration_m_per_s2) >= 0.0
        resting = regime == STUCK_REGIME and pressed
        if resting and not now["rests_for_good"]:
            now["rests_for_good_from_s"] = time_s
        now["rests_for_good"] = 1.0 if resting else 0.0

    def numbers(self) -> dict[str, float]:
        """Return the metrics so far; kinetic energy against work of force and live changes, and loss at the stop."""
        steady = self._steady.numbers()
        sums = {"drive_work_j": self._work.value, "stop_loss_j": self._loss.value, "change_work_j": self._change.value}
        given = sums["drive_work_j"] - sums["stop_loss_j"] + sums["change_work_j"]
        found = {**self._numbers, **steady, **sums, "energy_unbalanced_j": self._last_j - self._begin_j - given}
        if self._blow is not None and steady["steady_impact_periods"] > 0.0:
            metrics = self._blow(steady["steady_impact_speed_m_per_s"])
            found.update({f"steady_{name}": value for name, value in metrics.items()})
        return found
