# SPDX-License-Identifier: Apache-2.0
"""What a blow on the tool tells as a wave: energies, rebound, penetration, force, stress, contact; its gauge.

The blow of an event is led once more from the state before it, by the kernel that led it in the run.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.blow_gauge import BlowGauge, GaugeCurve
from mech_twin.machines.mb10_breaker.dynamics import Breaker
from mech_twin.machines.mb10_breaker.impacts import impact_direction
from mech_twin.machines.mb10_breaker.state import EventSide
from mech_twin.parts.rod_waves.blow import RodBlow
from mech_twin.parts.rod_waves.fatigue import StressLine
from mech_twin.parts.rod_waves.struck_tool import (
    force_room,
    gauge_numbers,
    gauge_room,
    life_numbers,
    place_m,
    rod_blow,
    strain_per_n,
)
from mech_twin.samples import Event


def tool_gauge(b: Breaker, sends_curve: bool) -> BlowGauge | None:
    """Return the strain gauge on the tool; None where the blow is no wave."""
    if not b.waves:
        return None

    def numbers(event: Event) -> tuple[float, ...]:
        return gauge_numbers(b.wave, blow_of(b, event, np.empty((0, 2)), np.empty((0, 1)))[0])

    def curve(event: Event) -> GaugeCurve:
        room = gauge_room(b.wave)
        found, _ = blow_of(b, event, room, np.empty((0, 1)))
        force = room[: found.steps].sum(axis=1)
        return GaugeCurve(b.wave.span_s, force, strain_per_n(b.wave) * force)

    return BlowGauge("blow", "tool", numbers, curve, sends_curve)


def blow_of(b: Breaker, event: Event, gauge: NDArray[np.float64], forces: NDArray[np.float64]) -> tuple[RodBlow, float]:
    """Return the blow of an event on the tool and its effective mass (kg); rows of both arrays are filled a step."""
    before, after = EventSide(*event.pre), EventSide(*event.post)
    takes_part = not b.held and after.body.velocity != before.body.velocity
    seated = b.held or before.body.position == 0.0
    along = impact_direction(b, before.crank.position, before.body.position, b.held or not takes_part, True)
    if takes_part:
        along = impact_direction(b, before.crank.position, before.body.position, False, False)
    tool = before.tool.velocity
    found = rod_blow(b.wave, along.effective_kg, event.pre_velocity_m_per_s, tool, seated or tool > 0.0, gauge, forces)
    return found, along.effective_kg


def blow_metrics(b: Breaker, event: Event, line: StressLine | None = None) -> dict[str, float]:
    """Return the metrics of one blow on the tool; of its life where an S-N line is given."""
    forces = np.empty((0, 1)) if line is None else force_room(b.wave)
    found, effective = blow_of(b, event, np.empty((0, 2)), forces)
    v, crank = event.pre_velocity_m_per_s, EventSide(*event.pre).crank
    rebound = v - found.impulse_ns / effective
    parting = found.tool_momentum_ns / b.tool_mass_kg - rebound
    return {
        "incident_energy_j": found.incident_energy_j,
        "transmitted_energy_j": found.transmitted_energy_j,
        "forward_energy_j": found.forward_energy_j,
        "reflected_energy_j": found.reflected_energy_j,
        "striker_rebound_m_per_s": -rebound,
        "restitution_effective": parting / v,
        "penetration_m": found.penetration_m,
        "peak_force_n": found.peak_force_n,
        "wall_peak_force_n": found.wall_peak_force_n,
        "peak_stress_pa": found.peak_stress_pa,
        "stress_place_m": place_m(b.wave, found.peak_stress_at_s),
        "peak_tension_pa": found.peak_tension_pa,
        "tension_place_m": place_m(b.wave, found.peak_tension_at_s),
        "blow_contact_time_s": found.contact_time_s,
        "blow_contacts": float(found.contacts),
        "blow_efficiency": found.transmitted_energy_j / found.striker_energy_j,
        "tool_energy_j": 0.5 * found.tool_momentum_ns**2 / b.tool_mass_kg,
        "tool_thrown_back_m_per_s": max(0.0, -found.tool_momentum_ns / b.tool_mass_kg),
        "tool_vibration_j": found.tool_vibration_j,
        "blow_window_s": found.duration_s,
        "crank_turn_in_contact_rad": abs(crank.velocity) * found.contact_time_s,
        **({} if line is None else life_numbers(b.wave, line, found, forces)),
    }
