# SPDX-License-Identifier: Apache-2.0
"""What a blow on the tool tells as a wave: energies, rebound, penetration, force, stress, contact; its gauge.

The blow of an event is led once more from the state before it, by the kernel that led it in the run.
"""

from __future__ import annotations

from functools import partial

from mech_twin.capabilities.blow_gauge import BlowGauge, GaugeCurve
from mech_twin.machines.mb10_breaker.dynamics import Breaker
from mech_twin.machines.mb10_breaker.impacts import ImpactDirection, impact_direction
from mech_twin.machines.mb10_breaker.state import EventSide
from mech_twin.machines.mb10_breaker.wave_blow import push_on_body
from mech_twin.parts.rod_waves.fatigue import StressLine
from mech_twin.parts.rod_waves.struck_tool import (
    NO_CURVE,
    NO_FORCES,
    LedBlow,
    gauge_curve,
    gauge_numbers,
    rod_blow,
    told_of_blow,
)
from mech_twin.samples import Event


def tool_gauge(b: Breaker, sends_curve: bool) -> BlowGauge | None:
    """Return the strain gauge on the tool; None where the blow is no wave."""
    if not b.waves:
        return None

    def numbers(event: Event) -> tuple[float, ...]:
        return gauge_numbers(b.wave, blow_of(b, event)[0](NO_CURVE, NO_FORCES))

    def curve(event: Event) -> GaugeCurve:
        return GaugeCurve(*gauge_curve(b.wave, blow_of(b, event)[0]))

    return BlowGauge("blow", ("tool",), numbers, curve, ("tool",) if sends_curve else ())


def blow_of(b: Breaker, event: Event) -> tuple[LedBlow, ImpactDirection]:
    """Return what leads the blow of an event on the tool once more, and its direction."""
    before = EventSide(*event.pre)
    rests = b.held or before.body.position == before.body.velocity == 0.0
    along = impact_direction(b, before.crank.position, before.body.position, rests, False)
    tool, closing = before.tool.velocity, event.pre_velocity_m_per_s
    return partial(rod_blow, b.wave, along.effective_kg, closing, tool, rests or tool > 0.0), along


def blow_metrics(b: Breaker, event: Event, line: StressLine | None = None) -> dict[str, float]:
    """Return the metrics of one blow on the tool; of its life where an S-N line is given."""
    lead, along = blow_of(b, event)
    found, told = told_of_blow(b.wave, line, lead)
    v, before = event.pre_velocity_m_per_s, EventSide(*event.pre)
    rebound = v - found.impulse_ns / along.effective_kg
    tool = found.tool_momentum_ns / b.tool_mass_kg
    body, thrown_back = before.body, max(0.0, -tool)
    p = body.velocity - along.y * found.impulse_ns
    push = push_on_body(b, before.crank.position, body.position, p, thrown_back)
    return {
        **told,
        "striker_rebound_m_per_s": -rebound,
        "restitution_effective": (tool - rebound) / v,
        "tool_thrown_back_m_per_s": thrown_back,
        "collar_push_ns": push.impulse_nms / b.tool_radius_m,
        "crank_turn_in_window_rad": abs(before.crank.velocity) * found.duration_s,
    }
