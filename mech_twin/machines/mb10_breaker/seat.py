# SPDX-License-Identifier: Apache-2.0
"""When a blow finds the tool seated: one definition for a run, for the half sine, and for both sizings.

The body is at most ``SEATED_GAP_M`` off its collar at the blow, and was at rest on it for at least ``SEATED_REST`` of
the cycle that the blow ends.  A gap alone has no margin: it is as small where the body has just come to rest as where
it has rested for half of the cycle.
"""

from __future__ import annotations

SEATED_GAP_M = 2e-5
SEATED_REST = 0.05  # part of the cycle


def is_seated(gap_m: float, contact_share: float) -> bool:
    """Return whether a blow finds the tool seated.

    Parameters
    ----------
    gap_m : float
        How far the body is off its collar at the blow, at the tool (m).
    contact_share : float
        Part of the cycle that the blow ends in which the body is at rest on its collar.
    """
    return gap_m <= SEATED_GAP_M and contact_share >= SEATED_REST
