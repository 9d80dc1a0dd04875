# SPDX-License-Identifier: Apache-2.0
"""Features of one cycle from a strain gauge on a struck rod, for any machine."""

from __future__ import annotations

from mech_twin.capabilities.cycle import CycleFeature, event_ratio, event_value


def gauge_features(kind: str, rod: str) -> tuple[CycleFeature, ...]:
    """Return the features of a gauge; a soft wall or a worn foot changes the reflected energy.

    Parameters
    ----------
    kind : str
        Kind of the events that it measures.
    rod : str
        Name of the rod: tool, stop.
    """
    incident, forward, reflected, peak = (
        f"event.{kind}.{what}" for what in ("incident_energy", "forward_energy", "reflected_energy", "peak_force")
    )
    return (
        event_value("incident_energy_j", "J", incident, f"energy of the first wave in the {rod}", "sum"),
        event_ratio("reflected_share", reflected, forward, "energy that comes back over that going forward", 1.0),
        event_value("gauge_peak_n", "N", peak, f"largest force in the {rod}", "largest"),
    )
