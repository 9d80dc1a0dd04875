# SPDX-License-Identifier: Apache-2.0
"""A blow through a contact of finite stiffness: peak force, contact time and loss of energy beside the impulse.

The closing motion y(q) - r_tool phi - (tool) is reduced to one mass and one rate: the reduced mass of tool and of what
the tool feels of crank and body, m_e = 1/(j' M^-1 j), and the rate at which the closing speed would fade without the
contact, a = -(j . (u', p') + j' . (u, p)): the striker nears the end of its travel and slows down.  Both are taken at
the first touch.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.accelerations import accelerations, moving
from mech_twin.machines.mb10_breaker.dynamics import Breaker, masses_at, striker
from mech_twin.parts.contact import ContactPulse, contact_pulse, damping_ratio, damping_ratio_without_pull


class BlowContact(NamedTuple):
    """One blow through a contact stiffness.

    The energy changes are relative to the rigid blow, negative for a loss: with the textbook damping of e_t (which
    parts somewhat faster than e_t v), and with the damping that keeps e_t exactly.
    """

    peak_force_n: float
    duration_s: float
    energy_change: float
    energy_change_restitution_kept: float

    @property
    def metrics(self) -> dict[str, float]:
        """The numbers by name; of a blow whose contact does not end by itself the peak force alone."""
        if not math.isfinite(self.duration_s + self.energy_change + self.energy_change_restitution_kept):
            return {"contact_peak_force_n": self.peak_force_n}
        return {
            "contact_peak_force_n": self.peak_force_n,
            "contact_time_s": self.duration_s,
            "contact_blow_energy_change": self.energy_change,
            "contact_blow_energy_change_restitution_kept": self.energy_change_restitution_kept,
        }


@kernel
def fading(b: Breaker, q: float, u: float, phi: float, p: float, drive: float, rests: bool) -> float:
    """Return the rate (m/s^2) at which the closing speed falls before the tool answers."""
    _, slope, bend = striker(b, q)
    du, dp, _ = accelerations(b, masses_at(b, q, phi), u, phi, p, drive, rests, moving(u, p))
    return -(slope * du + bend * u * u - b.tool_radius_m * dp)


def blow_contact(
    b: Breaker, stiffness_n_per_m: float, closing: float, impulse: float, fading_m_per_s2: float
) -> BlowContact:
    """Return the blow through a contact stiffness.

    Parameters
    ----------
    b : Breaker
        Constants.
    stiffness_n_per_m : float
        Contact stiffness of striking face and tool, N/m.
    closing, impulse : float
        Closing speed (m/s) and impulse (N s) of the rigid blow; its reduced mass is P/((1 + e_t) v).
    fading_m_per_s2 : float
        Rate at which the closing speed falls by itself, as `fading` gives it.
    """
    e = b.tool_restitution
    mass = impulse / ((1.0 + e) * closing)

    def pulse(damping: float) -> ContactPulse:
        return contact_pulse(mass, stiffness_n_per_m, damping, closing, fading_m_per_s2)

    usual, kept = pulse(damping_ratio(e)), pulse(damping_ratio_without_pull(e))
    return BlowContact(
        usual.peak_force_n,
        usual.duration_s,
        (usual.impulse_ns / impulse) ** 2 - 1.0,
        (kept.impulse_ns / impulse) ** 2 - 1.0,
    )
