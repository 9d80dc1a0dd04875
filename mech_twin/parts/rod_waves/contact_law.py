# SPDX-License-Identifier: Apache-2.0
r"""Force of a contact, or of a wall, over its compression; no law pulls but the bonded one.

::

    F |        /|  loading: k_l beyond the threshold F_0       u    compression; below 0 a gap
      |  F_0  / |                                              u_m  largest so far, at least F_0/k_u
      |   .--'  |  k_u: up to F_0, unloading and reloading     u_p  permanent part
      |  /     /   up to u_m
      +-/-----/------> u                                       k_l = 0: yields at F_0;  k_u = k_l: elastic
             u_p  u_m

A step of time takes the mean force F = (1/s) int F du over its change s of compression along the law, so the work F s
is exact and the balance of energy closes to rounding.  A contact with k_u > k_l has the restitution sqrt(k_l/k_u).

A power law F = k u^n unloads along a line of r times the secant F_m/u_m, so that u_p = (1 - 1/r) u_m; passive for
r >= (n + 1)/2.  Damping adds d u' while the sides touch; the force is never below 0.
"""

import math
from typing import NamedTuple

from mech_twin.kernels.kernel import kernel

FREE, RIGID, BONDED, PIECEWISE, HERTZ, POWER = range(6)
MOST_ITERATIONS = 100
CLOSED = 1e-15  # of the change of compression


class ContactLaw(NamedTuple):
    """One law: kind, k_l (N/m, of a Hertz contact N/m^1.5, of a power law N/m^n), k_u (N/m), F_0 (N), n, d (N s/m).

    ``unloading`` of a power law is r, the slope of unloading over the secant.
    """

    kind: int
    loading: float
    unloading: float
    threshold_n: float
    exponent: float = 1.0
    damping: float = 0.0


LAW_COLUMNS = len(ContactLaw._fields)


FREE_END = ContactLaw(FREE, 0.0, 1.0, 0.0)
RIGID_FACE = ContactLaw(RIGID, 0.0, 1.0, 0.0)
BOND = ContactLaw(BONDED, 0.0, 1.0, 0.0)


def linear_contact(stiffness_n_per_m: float, restitution: float = 1.0) -> ContactLaw:
    """Return a linear contact; a restitution below 1 makes its unloading k_l/e^2."""
    return ContactLaw(PIECEWISE, stiffness_n_per_m, stiffness_n_per_m / restitution**2, 0.0)


def hertz_contact(reduced_modulus_pa: float, radius_m: float) -> ContactLaw:
    """Return the contact F = (4/3) E* sqrt(R) u^(3/2) of a rounded face."""
    return ContactLaw(HERTZ, 4.0 / 3.0 * reduced_modulus_pa * math.sqrt(radius_m), 1.0, 0.0)


def yielding_wall(force_n: float, stiffness_n_per_m: float) -> ContactLaw:
    """Return a wall that gives way at a constant force."""
    return ContactLaw(PIECEWISE, 0.0, stiffness_n_per_m, force_n)


def power_wall(stiffness_n_per_m: float, exponent: float, at_m: float, ratio: float) -> ContactLaw:
    """Return F = k u_1 (u/u_1)^n, unloading ``ratio`` times as steeply as the secant; k is the secant at u_1."""
    return ContactLaw(POWER, stiffness_n_per_m * at_m ** (1.0 - exponent), ratio, 0.0, exponent)


@kernel
def yields(law: ContactLaw) -> bool:
    """Return whether a law remembers the largest compression."""
    return law.kind == POWER or law.unloading > law.loading


@kernel
def unloading_slope(law: ContactLaw, most: float) -> float:
    """Return the slope (N/m) of unloading from a largest compression."""
    if law.kind == POWER:
        return law.unloading * law.loading * most ** (law.exponent - 1.0) if most > 0.0 else 0.0
    return law.unloading


@kernel
def envelope(law: ContactLaw, u: float) -> float:
    """Return the loading force (N) at a compression of at least F_0/k_u."""
    if law.kind == POWER:
        return float(law.loading * u**law.exponent) if u > 0.0 else 0.0
    return law.threshold_n + law.loading * (u - law.threshold_n / law.unloading)


@kernel
def under_envelope(law: ContactLaw, low: float, high: float) -> float:
    """Return the area (J) under the loading force between two compressions."""
    if law.kind == POWER:
        n = law.exponent + 1.0
        return float(law.loading / n * (high**n - low**n))
    return 0.5 * (envelope(law, low) + envelope(law, high)) * (high - low)


@kernel
def permanent(law: ContactLaw, most: float) -> float:
    """Return the permanent part u_p (m) after a largest compression."""
    if law.kind == POWER:
        return most * (1.0 - 1.0 / law.unloading)
    if law.kind != PIECEWISE or law.loading == law.unloading:
        return 0.0
    return most - envelope(law, most) / law.unloading


@kernel
def contact_force(law: ContactLaw, most: float, u: float) -> float:
    """Return the force (N) at a compression u (m) after a largest one."""
    if u <= 0.0:
        return 0.0
    if law.kind == HERTZ:
        return law.loading * u * math.sqrt(u)
    if u > most:
        return envelope(law, u)
    return max(0.0, unloading_slope(law, most) * (u - permanent(law, most)))


@kernel
def area(law: ContactLaw, most: float, start: float, end: float) -> float:
    """Return int F du (J) from one compression to another; both lines of the law are integrated without error."""
    low, high = min(start, end), max(start, end)
    if law.kind == HERTZ:
        low, high = max(low, 0.0), max(high, 0.0)
        if high == low:
            return 0.0
        a, b = math.sqrt(low), math.sqrt(high)
        found = 0.4 * law.loading * (high - low) / (a + b) * (a**4 + a**3 * b + a * a * b * b + a * b**3 + b**4)
    else:
        foot, found = permanent(law, most), 0.0
        first, last = max(low, foot), min(high, most)
        if last > first:
            found = 0.5 * unloading_slope(law, most) * (last - first) * ((first - foot) + (last - foot))
        first = max(low, most)
        if high > first:
            found += under_envelope(law, first, high)
    return found if end >= start else -found


@kernel
def mean_force(law: ContactLaw, most: float, start: float, change: float, span: float) -> float:
    """Return the mean force (N) over a change of compression in a span of time (s)."""
    end = start + change
    if end == start:
        return contact_force(law, most, start)
    force = area(law, most, start, end) / (end - start)  # not by the change: it is rounded in the end
    if law.damping == 0.0:
        return force
    return max(0.0, force + law.damping * (max(end, 0.0) - max(start, 0.0)) / span)


@kernel
def force_of_step(
    law: ContactLaw, most: float, start: float, closing: float, yielding: float, span: float
) -> tuple[float, float]:
    """Return mean force (N) and change of compression (m) of a step of time.

    The sides close at ``closing - yielding F`` (m/s; ``yielding`` in m/(N s)), so s = (closing - yielding F) span with
    F the mean over s, which grows with s: one root, by Newton's method between bounds.
    """
    if law.kind == FREE:
        return 0.0, closing * span
    if law.kind == BONDED or (law.kind == RIGID and start >= 0.0 and closing > 0.0):
        return closing / yielding, 0.0
    free = closing * span
    if law.kind == RIGID or (start <= 0.0 and start + free <= 0.0):
        return 0.0, free
    largest = contact_force(law, most, max(start, start + free)) + law.damping * max(free, 0.0) / span
    high, low = free, free - yielding * span * largest
    change, last = 0.5 * (low + high), high - low
    for _ in range(MOST_ITERATIONS):
        force = mean_force(law, most, start, change, span)
        missed = change + yielding * span * force - free
        if missed > 0.0:
            high = change
        else:
            low = change
        slope = 0.0 if change == 0.0 else (contact_force(law, most, start + change) - force) / change
        better = change - missed / (1.0 + yielding * span * max(slope, 0.0))
        if abs(better - change) <= CLOSED * (abs(free) + abs(start)):
            change = better
            break
        if not low < better < high or abs(better - change) > 0.5 * last:  # a kink may send it to and fro for good
            better = 0.5 * (low + high)
        last, change = abs(better - change), better
    return mean_force(law, most, start, change, span), change


@kernel
def stored(law: ContactLaw, most: float, u: float) -> float:
    """Return the elastic energy (J) at a compression."""
    if u <= 0.0:
        return 0.0
    if law.kind == HERTZ:
        return 0.4 * law.loading * u * u * math.sqrt(u)
    if law.kind not in (PIECEWISE, POWER):
        return 0.0
    force, largest = contact_force(law, most, u), max(u, most)
    return 0.5 * force * force / unloading_slope(law, largest)
