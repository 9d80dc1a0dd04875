# SPDX-License-Identifier: Apache-2.0
r"""An impact through a contact of finite stiffness: force, duration, and impulse compared with a rigid impact.

::

      m_1  ---> v      F = k d + c d'  while positive          F |   .-~-.
    +-----+          +-----+                                     |  /     \        peak force
    |     |-[k, c]-->|     |       d   compression               | |       \
    +-----+          +-----+       a   speed at which the        | |        \
                       m_2             approach fades by itself  +-+---------\----> t
                                                                   0         duration

With m the reduced mass, w^2 = k/m and c = 2 zeta m w, from the first touch to the instant at which the force ends,

    m d'' + c d' + k d = -m a,      d(0) = 0,  d'(0) = v

``a`` is what the two bodies' own motion would do to the approach without the contact (a striker near the end of its
travel slows down, a > 0).  The contact only pushes: it ends where F falls to zero, before d does.

A coefficient of restitution e is turned into damping in two ways.  ``damping_ratio`` is the textbook relation
e = exp(-pi zeta/sqrt(1 - zeta^2)), which follows the oscillation to d = 0 although the force would pull there: ended at
F = 0, the bodies part somewhat faster than e v.  ``damping_ratio_without_pull`` is the damping with which they part at
e v exactly (Schwager and Poeschel, Granular Matter 9 (2007) 465).
"""

import math
from typing import NamedTuple

from mech_twin.kernels.kernel import kernel

STEPS_PER_SCALE = 64  # of the shortest time in the motion: no sign change of the force can hide between two
SOFTEST_RESTITUTION = 1e-4  # a smaller one is taken as this: the damping grows without bound towards e = 0
MOST_STEPS = 1_000_000


class ContactPulse(NamedTuple):
    """Force and time of one blow, and how the bodies part.

    ``impulse_ns`` is the time integral of the force; ``parting_speed_m_per_s`` the speed at which the bodies part.
    """

    peak_force_n: float
    duration_s: float
    impulse_ns: float
    parting_speed_m_per_s: float


@kernel
def _waves(damping_ratio: float, tau: float) -> tuple[float, float]:
    """Return e^(-zeta tau) cos(w tau) and e^(-zeta tau) sin(w tau)/w, w^2 = 1 - zeta^2 of either sign."""
    square = 1.0 - damping_ratio * damping_ratio
    if square < 0.0:
        w = math.sqrt(-square)
        slow, fast = math.exp((w - damping_ratio) * tau), math.exp(-(w + damping_ratio) * tau)
        if w * tau > 1e-4:
            return 0.5 * (slow + fast), 0.5 * (slow - fast) / w
    fade, angle = math.exp(-damping_ratio * tau), math.sqrt(abs(square)) * tau
    if angle <= 1e-4:  # two terms of either series are exact here
        turn = square * tau * tau
        return fade * (1.0 - 0.5 * turn), fade * tau * (1.0 - turn / 6.0)
    return fade * math.cos(angle), fade * math.sin(angle) / math.sqrt(square)


@kernel
def _compression(damping_ratio: float, fading: float, tau: float) -> tuple[float, float]:
    """Return d and d' in units of v/w and v, at tau = w t; ``fading`` is a/(v w)."""
    cosine, sine = _waves(damping_ratio, tau)
    d = fading * cosine + (1.0 + damping_ratio * fading) * sine - fading
    return d, cosine - (fading + damping_ratio) * sine


@kernel
def _force(damping_ratio: float, fading: float, tau: float) -> float:
    """Return the force in units of m v w."""
    d, rate = _compression(damping_ratio, fading, tau)
    return d + 2.0 * damping_ratio * rate


@kernel
def _force_slope(damping_ratio: float, fading: float, tau: float) -> float:
    """Return the derivative of the force in tau."""
    d, rate = _compression(damping_ratio, fading, tau)
    return rate - 2.0 * damping_ratio * (fading + 2.0 * damping_ratio * rate + d)


@kernel
def _bisected(damping_ratio: float, fading: float, low: float, high: float, of_slope: bool) -> float:
    """Return the time between two others at which the force, or its slope, falls through zero."""
    for _ in range(60):
        middle = 0.5 * (low + high)
        value = _force_slope(damping_ratio, fading, middle) if of_slope else _force(damping_ratio, fading, middle)
        if value > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def contact_pulse(
    mass_kg: float,
    stiffness_n_per_m: float,
    damping_ratio: float,
    closing_speed_m_per_s: float,
    fading_m_per_s2: float = 0.0,
) -> ContactPulse:
    """Return the pulse of a blow through a linear spring and dashpot that only push.

    Parameters
    ----------
    mass_kg : float
        Reduced mass of the two bodies, m, kg.
    stiffness_n_per_m : float
        Contact stiffness k, N/m.
    damping_ratio : float
        zeta = c/(2 sqrt(k m)), at least 0.
    closing_speed_m_per_s : float
        Speed of approach at the first touch, above 0.
    fading_m_per_s2 : float
        Rate at which the approach slows down without the contact, a; negative where it grows.

    Returns
    -------
    ContactPulse
        The impulse follows from the momentum of the approach: m (v - d'(end) - a t_end).  Where an approach that grows
        never lets the force end, duration and impulse are inf.
    """
    frequency = math.sqrt(stiffness_n_per_m / mass_kg)
    scale = mass_kg * closing_speed_m_per_s * frequency
    fading = fading_m_per_s2 / (closing_speed_m_per_s * frequency)
    step = 1.0 / (STEPS_PER_SCALE * (1.0 + 2.0 * damping_ratio + abs(fading)))
    peak, tau, risen = _force(damping_ratio, fading, 0.0), 0.0, _force_slope(damping_ratio, fading, 0.0) > 0.0
    for _ in range(MOST_STEPS):
        after = tau + step
        if risen and _force_slope(damping_ratio, fading, after) <= 0.0:
            top = _bisected(damping_ratio, fading, tau, after, True)
            peak, risen = max(peak, _force(damping_ratio, fading, top)), False
        if _force(damping_ratio, fading, after) <= 0.0:
            end = _bisected(damping_ratio, fading, tau, after, False)
            rate = _compression(damping_ratio, fading, end)[1]
            impulse = mass_kg * closing_speed_m_per_s * (1.0 - rate - fading * end)
            return ContactPulse(scale * peak, end / frequency, impulse, -rate * closing_speed_m_per_s)
        tau = after
    return ContactPulse(scale * peak, math.inf, math.inf, 0.0)


@kernel
def damping_ratio(restitution: float) -> float:
    """Return zeta of e = exp(-pi zeta/sqrt(1 - zeta^2)): 0 at e = 1, 1 at e = 0."""
    if restitution <= 0.0:
        return 1.0
    decay = -math.log(restitution)
    return decay / math.sqrt(math.pi * math.pi + decay * decay)


@kernel
def damping_ratio_without_pull(restitution: float) -> float:
    """Return zeta with which bodies that part where the force ends do so at e times their approach.

    Above 1 for e below exp(-2); an e below ``SOFTEST_RESTITUTION`` is taken as that.
    """
    wanted = max(restitution, SOFTEST_RESTITUTION)
    if wanted >= 1.0:
        return 0.0
    low, high = 0.0, 1.0
    while contact_pulse(1.0, 1.0, high, 1.0).parting_speed_m_per_s > wanted:
        low, high = high, 2.0 * high
    for _ in range(60):
        middle = 0.5 * (low + high)
        if contact_pulse(1.0, 1.0, middle, 1.0).parting_speed_m_per_s > wanted:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
