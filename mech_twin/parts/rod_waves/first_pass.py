# SPDX-License-Identifier: Apache-2.0
"""Share of a striker's energy that a linear wall takes from the first wave of a long rod: closed forms, and as led.

The wall keeps its largest work, as with a rigid unloading.  Both forms follow from Z u' + k u = 2 p with the incident
wave p of the striker (LundbergPercussive1982).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from mech_twin.parts.rod_waves.blow import Window, lead_blow
from mech_twin.parts.rod_waves.chain import Chain, ChainState, Section, chain_of, set_speed
from mech_twin.parts.rod_waves.contact_law import FREE_END, RIGID_FACE, linear_contact

UNIT = Section(1, 1.0, 1.0, 0.0)
CELLS = 400
Steps = Sequence[tuple[float, float]]  # from the back to the face: share of the transit time, impedance over the tool's
STRIKERS: Mapping[str, Steps] = MappingProxyType(
    {
        "twice the impedance": ((1.0, 2.0),),
        "thick, thin at the face": ((0.6, 2.5), (0.4, 1.0)),
        "thin, thick at the face": ((0.4, 1.0), (0.6, 2.5)),
        "thick amid thin ends": ((0.35, 0.8), (0.3, 2.0), (0.35, 1.0)),
    }
)


def share_of_rectangle(x: float) -> float:
    """Return 2 (1 - exp(-x))^2/x, x = 2 L k/(c Z): a striker that is a rod of length L and the tool's impedance."""
    return 2.0 * math.expm1(-x) * math.expm1(-x) / x


def share_of_mass(a: float) -> float:
    """Return 4 a a^(-2 a/(a - 1)), a = k M/Z^2: a rigid striker of mass M; 4/e^2 at a = 1."""
    if abs(a - 1.0) < 1e-9:
        return 4.0 * math.exp(-2.0)
    return float(4.0 * a * a ** (-2.0 * a / (a - 1.0)))


def led_share_of_rectangle(x: float, cells: int = CELLS) -> float:
    """Return the share of the rod as a striker, led on a grid of so many cells a striker."""
    return led_share_of_steps(((1.0, 1.0),), x, cells)


def led_share_of_steps(steps: Steps, x: float, cells: int = CELLS) -> float:
    """Return the share of a striker of several sections, led on a grid of so many cells a striker.

    Parameters
    ----------
    steps : sequence of pairs
        Of each section: share of the striker's transit time T, impedance over the tool's Z.
    x : float
        2 k T/Z of the wall; that of `share_of_rectangle` for a uniform striker.
    cells : int
        Cells of the striker.
    """
    sections = [UNIT._replace(cells=round(part * cells), impedance=z) for part, z in steps]
    own = sum(section.cells for section in sections)
    rods = [sections, [UNIT._replace(cells=8 * cells)]]
    wall = linear_contact(0.5 * x)  # striker of transit time 1
    chain, state = chain_of(rods, [FREE_END, RIGID_FACE, wall], [0.0, 0.0, 0.0], 1.0 / cells)
    set_speed(chain, state, 0, own, 1.0)
    return _led(chain, state, 1, 15.9)


def led_share_of_mass(a: float, cells: int = CELLS) -> float:
    """Return the share of the rigid striker, led on a grid of so many cells a unit of time M/Z."""
    chain, state = chain_of(
        [[UNIT._replace(cells=8 * cells)]], [RIGID_FACE, linear_contact(a)], [0.0, 0.0], 1.0 / cells, 1.0
    )
    state.mass_speed[0] = 1.0
    return _led(chain, state, 0, 15.9)


def _led(chain: Chain, state: ChainState, struck: int, limit_s: float) -> float:
    none = np.zeros((0, 2))
    room = np.zeros(len(chain.starts))
    found = lead_blow(chain, state, Window(struck, 0, limit_s), room, none, np.zeros((0, 1)), 1)
    return float(found.wall_peak_work_j / found.striker_energy_j)
