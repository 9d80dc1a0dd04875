# SPDX-License-Identifier: Apache-2.0
"""A generator of a periodic force with two levels.

::

      P |      P1
        |  +-------+                +-------+
        |  |       |                |       |
      --+--+-------+------------+---+-------+----> t
        |  0      t1            |   T      T + t1
        |          +------------+
        |                P2

Phase 1 lasts from nT to nT + t1, phase 2 from there to (n + 1)T; an instant of change belongs to the phase that ends.
The force is positive towards the stop.  The supply command multiplies both levels; 1 is nominal, 0 is off.

Source: manzhosov_novikov, eq. (2) and fig. 1.
"""

from __future__ import annotations

from typing import Self

from pydantic import model_validator

from mech_twin.declarations.quantity import Parameters, quantity
from mech_twin.kernels.kernel import kernel

LEAST_SHARE = 1e-10  # of the period, of either phase: rounding of a shorter one is of its own size


class GeneratorParameters(Parameters):
    """The two-level periodic force."""

    period_s: float = quantity("s", "period T of the force", gt=0)
    phase1_duration_s: float = quantity("s", "duration t1 of the first phase, 0 < t1 < T")
    phase1_force_n: float = quantity("N", "force P1 of the first phase, positive towards the stop", live=True)
    phase2_force_n: float = quantity("N", "force P2 of the second phase, positive towards the stop", live=True)

    @model_validator(mode="after")
    def _phases_in_order(self) -> Self:
        if not 0.0 < self.phase1_duration_s < self.period_s:
            raise ValueError(
                f"0 < phase1_duration_s < period_s does not hold: phase1_duration_s = {self.phase1_duration_s!r}, "
                f"period_s = {self.period_s!r}"
            )
        shortest = LEAST_SHARE * self.period_s
        if min(self.phase1_duration_s, self.period_s - self.phase1_duration_s) < shortest:
            raise ValueError(
                f"phase1_duration_s = {self.phase1_duration_s!r} leaves a phase shorter than {LEAST_SHARE:g} period_s "
                f"= {shortest!r} s"
            )
        return self


@kernel
def mean_level(period_s: float, phase1_duration_s: float, level1: float, level2: float) -> float:
    """Return <P> = (P1 t1 + P2 (T - t1))/T, in the unit of the levels."""
    return (level1 * phase1_duration_s + level2 * (period_s - phase1_duration_s)) / period_s
