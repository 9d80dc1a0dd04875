# SPDX-License-Identifier: Apache-2.0
"""Peak force, contact time and loss of an impact at a stop of finite stiffness, as an estimate beside the impulse.

::

    F |        /|  loading: F = k d               d: penetration of the stop
      |      /  |  unloading: F = k/R^2 (d - d0)
      |    /   /   d0 = (1 - R^2) d_max stays when the mass leaves
      |  /    /
      |/_____/____ d
            d0

The force P of the generator acts on during the contact.  With w = sqrt(k/m), equation by equation in closed form:

Loading, m d'' = P - k d from d = 0, d' = v-: the peak force is F = P + sqrt(P^2 + m k v-^2).
Unloading, m d'' = P - k/R^2 (d - d0) from rest: the mass leaves with exactly R v-, whatever P is.
The coefficient of restitution is therefore kept, and the motion is that of the rigid stop.

Valid while the flight between impacts is long against the contact: below `merging_speed` the impacts of a series merge
into one contact.  Source: Walton and Braun, J. Rheology 30 (1986) 949, the hysteretic spring; the force is ours.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mech_twin.kernels.kernel import kernel


class ContactEstimate(NamedTuple):
    """Estimates for one impact at a stop of finite stiffness.

    ``loss_j`` is the energy dissipated: loss of kinetic energy, and work of the force over the permanent penetration.
    """

    peak_force_n: float
    contact_time_s: float
    penetration_m: float
    loss_j: float


@kernel
def contact_estimate(
    mass_kg: float, speed_m_per_s: float, restitution: float, stiffness_n_per_m: float, force_n: float
) -> ContactEstimate:
    """Return peak force, contact time, largest penetration and loss of one impact.

    Parameters
    ----------
    mass_kg : float
        Mass.
    speed_m_per_s : float
        Speed v- before the impact, > 0.
    restitution : float
        R.
    stiffness_n_per_m : float
        Stiffness k of the stop when it is loaded.
    force_n : float
        Force P on the mass during the contact, positive towards the stop.
    """
    m, v, r, k, p = mass_kg, speed_m_per_s, restitution, stiffness_n_per_m, force_n
    inertial = math.sqrt(m * k) * v
    swing = math.hypot(p, inertial)
    peak = p + swing if p >= 0.0 else inertial * inertial / (swing - p)
    radians = math.atan2(inertial, -p) + r * math.acos(-p / swing)
    penetration = peak / k
    stays = (1.0 - r) * (1.0 + r) * penetration
    loss = 0.5 * m * v * v * (1.0 - r) * (1.0 + r) + p * stays
    return ContactEstimate(peak, radians * math.sqrt(m / k), penetration, loss)


def merging_speed(mass_kg: float, restitution: float, stiffness_n_per_m: float, force_n: float) -> float:
    """Return the impact speed (m/s) below which the next impact comes before this contact is over; 0 if never.

    The flight after an impact lasts 2 R v/A, A = P/m > 0; the contact is taken at small P: pi/2 (1 + R) sqrt(m/k).
    """
    if force_n <= 0.0:
        return 0.0
    contact_s = 0.5 * math.pi * (1.0 + restitution) * math.sqrt(mass_kg / stiffness_n_per_m)
    return force_n / mass_kg * contact_s / (2.0 * restitution)
