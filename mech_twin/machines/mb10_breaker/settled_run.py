"""A run of the breaker from standstill until it is steady, and the breaker with another preload."""

from __future__ import annotations

from mech_twin.capabilities.variation import varied
from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters

SETTLED_S = 8.0  # of a run from standstill: some eighty blows, the last twenty of which count


def settled_run_metrics(parameters: BreakerParameters, duration_s: float = SETTLED_S) -> dict[str, float]:
    """Return the metrics of a run from standstill, the means and peaks of its last blows among them."""
    machine = build(parameters)
    observer = machine.observer()
    for frame in frames(machine, duration_s):
        observer.observe(frame)
    return observer.numbers()


def with_rest_force(parameters: BreakerParameters, rest_force_n: float) -> BreakerParameters:
    """Return the breaker with the preload that gives this spring force at rest."""
    deflection = rest_force_n / parameters.body.spring_rate_n_per_m
    return varied(parameters, {"body.preload_deflection_m": deflection})
