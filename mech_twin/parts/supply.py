# SPDX-License-Identifier: Apache-2.0
"""Supply of a drive: the fraction of rated frequency in force, following what was asked at a limited rate.

::

    fraction 1 |        ________   asked
               |       /           in force: at most rate_per_s
             0 |______/            0 is off: the motor gives no torque
"""

from __future__ import annotations

from mech_twin.declarations.quantity import Parameters, quantity
from mech_twin.kernels.kernel import kernel


class SupplyParameters(Parameters):
    """Supply of the drive: what is in force at the start, and how fast it follows the command."""

    initial_fraction: float = quantity("1", "fraction of rated supply frequency in force at the start", ge=0.0, le=1.0)
    rate_per_s: float = quantity("1/s", "largest change of the supply fraction per second", gt=0.0, live=True)


@kernel
def limited_change(value: float, wanted: float, reach: float) -> float:
    """Return ``value`` moved towards ``wanted`` by at most ``reach``, which it meets exactly."""
    if wanted > value + reach:
        return value + reach
    if wanted < value - reach:
        return value - reach
    return wanted


@kernel
def limited_command(command: float, target: float, rate_per_s: float, step_s: float) -> float:
    """Return the supply fraction one step later: ``command`` moved towards ``target`` by at most ``rate step``.

    Parameters
    ----------
    command : float
        Fraction in force at the step before.
    target : float
        Fraction asked for; kept within 0 and 1.
    rate_per_s : float
        Largest change per second, positive.
    step_s : float
        Length of the step, s.
    """
    return limited_change(command, min(max(target, 0.0), 1.0), rate_per_s * step_s)
