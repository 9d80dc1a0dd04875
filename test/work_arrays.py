# SPDX-License-Identifier: Apache-2.0
"""Work arrays of the one loop and of a step, for systems that tests declare."""

import numpy as np

from mech_twin.engine.hybrid.loop import Room, room_in, room_sizes
from mech_twin.engine.integration import DORMAND_PRINCE_5, Tableau, Workspace
from mech_twin.kernels.kernel import kernel


@kernel
def room_for(freedoms: int, laws: int, signals: int, size: int) -> Room:
    """Return new work arrays for a system."""
    numbers, marks = room_sizes(freedoms, laws, signals, size)
    places = np.zeros(marks, dtype=np.int64)
    return room_in(np.zeros(numbers), places, freedoms, laws, signals, size, DORMAND_PRINCE_5)


def workspace(tableau: Tableau, size: int) -> Workspace:
    """Return work arrays for a system of ``size`` equations."""
    return Workspace(np.empty((len(tableau.nodes), size)), np.empty(size), np.empty(size))
