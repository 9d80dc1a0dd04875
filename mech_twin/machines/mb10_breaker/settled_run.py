# SPDX-License-Identifier: Apache-2.0
"""A run of the breaker from standstill until it is steady, and the breaker with another preload."""

from __future__ import annotations

from typing import NamedTuple

from pydantic import ValidationError

from mech_twin.capabilities.variation import varied
from mech_twin.engine.run import frames, rated, shorter_step_s, steps_for
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.body_cycle_metrics import BodyCycle
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.state import EventSide
from mech_twin.samples import LinkageSample

SETTLED_S = 8.0  # of a run from standstill: some eighty blows, the last twenty of which count
COUNTED_S = 6.0  # from then on a cycle counts as steady in a seating run of SETTLED_S


class Seating(NamedTuple):
    """How a run from standstill sits on its tool: blows, misses, worst gap and flight of all, extremes once steady."""

    blows: int
    missed: int
    gap_at_blow_m: float
    flight_share: float
    return_speed_m_per_s: float
    largest_force_n: float


def settled_run_metrics(parameters: BreakerParameters, duration_s: float = SETTLED_S) -> dict[str, float]:
    """Return the metrics of a run from standstill, the means and peaks of its last blows among them."""
    machine = build(parameters)
    observer = machine.observer()
    for frame in frames(machine, duration_s):
        observer.observe(frame)
    return observer.numbers()


def seating(parameters: BreakerParameters, duration_s: float = SETTLED_S) -> Seating:
    """Return how a run sits on its tool, from motor and linkage alone.

    The linkage leads crank and body together, so forces and the body's own role are not needed: four times as fast as
    `settled_run_metrics`.  Gap, flight and misses are of all blows from standstill, return speed and force of the last
    quarter.
    """
    machine = build(parameters)
    linkage = machine.linkage.start()
    radius, body = parameters.body.tool_radius_m, parameters.body
    blows = missed = 0
    gap = flight = returned = lift = 0.0
    cycle = BodyCycle(0.0, 0.0)
    for step in range(1, steps_for(machine, duration_s) + 1):
        motor = machine.motor.respond(linkage, rated(step - 1))
        linkage = machine.linkage.advance(linkage, motor, None)
        steady = linkage.time_s > duration_s * COUNTED_S / SETTLED_S
        for event in linkage.events:
            if event.contact == "collar":
                cycle.take_event(event)
            if event.contact == "tool":
                blows += event.kind == "blow"
                missed += event.kind in {"missed", "stalled"}
                if event.kind == "blow":
                    gap = max(gap, radius * EventSide(*event.pre).body.position)
                    flight = max(flight, 1.0 - cycle.contact_share(event.time_s))
                    cycle = cycle.next(event)
            elif steady and event.kind in {"touchdown", "settled"}:
                returned = max(returned, abs(event.pre_velocity_m_per_s))
        if steady:
            lift = max(lift, _body_angle(linkage))
    force = body.spring_rate_n_per_m * (body.spring_arm_m * lift + body.preload_deflection_m)
    return Seating(blows, missed, gap, flight, returned, force)


def in_shorter_steps(parameters: BreakerParameters, duration_s: float = SETTLED_S) -> BreakerParameters:
    """Return the breaker in a shorter coupling step; as it is where that is the shortest allowed."""
    try:
        return varied(parameters, {"coupling.step_s": shorter_step_s(build(parameters), duration_s)})
    except ValidationError:
        return parameters


def _body_angle(linkage: LinkageSample) -> float:
    return linkage.position[linkage.joints.index("body")]


def with_rest_force(parameters: BreakerParameters, rest_force_n: float) -> BreakerParameters:
    """Return the breaker with the preload that gives this spring force at rest."""
    deflection = rest_force_n / parameters.body.spring_rate_n_per_m
    return varied(parameters, {"body.preload_deflection_m": deflection})
