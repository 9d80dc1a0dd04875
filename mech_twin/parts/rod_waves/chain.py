# SPDX-License-Identifier: Apache-2.0
r"""A chain of rods on a grid of equal transit time: waves by characteristics, contacts, a rigid mass at its left end.

::

      M --> V     cell 0          cell 1 ...            cell n
    +-----+    +--------+--------+-----+     +-------+      |/
    |     |-c->| p -->  | p -->  |     |--c->|       |--c-->|/ wall      F = p + q   compression positive
    |     |    |  <-- q |  <-- q |     |     |       |      |/          v = (p - q)/Z,  Z = rho c A
    +-----+    +--------+--------+-----+     +-------+      |/
     contact 0                      contact 1      contact 2

In a step of time each wave moves on by one cell, exactly.  At a change of section, r = (Z_1 - Z_2)/(Z_1 + Z_2):
p_2' = p_1 + r (q_2 - p_1), q_1' = q_2 + r (q_2 - p_1).  At a contact both waves are held constant over the step, with
the mean force of `contact_law`.  A cell of transit time h holds the energy (p^2 + q^2) h/Z and the momentum (p - q) h.
Loss: of each cell's force the share pi eta/n is taken in a step, n cells of the rod, so that its first free vibration
loses the share 2 pi eta of its energy in a period; momentum stays.

A mass between two contacts is a rod of one cell.  Sources: GoldsmithImpact1960; LundbergPercussive1982.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernels.kernel import borrowing_kernel
from mech_twin.parts.rod_waves.contact_law import ContactLaw, force_of_step, stored, yields

Array = NDArray[np.float64]
Whole = NDArray[np.int64]


class Section(NamedTuple):
    """A uniform piece of rod on the grid: whole cells, impedance (N s/m), area (m2), share of force lost in a step."""

    cells: int
    impedance: float
    area_m2: float
    loss: float


class Chain(NamedTuple):
    """Constants of a chain of n cells and m contacts; cells ``starts[j - 1]`` to ``starts[j]`` lie left of contact j.

    ``starts`` is 0 for the contact of the mass and n for the wall.
    """

    span_s: float  # transit time of a cell
    mass_kg: float  # 0: no mass
    impedance: Array  # (n,)
    area_m2: Array  # (n,)
    reflection: Array  # (n,), at the left end of each cell
    loss: Array  # (n,)
    starts: Whole  # (m,)
    laws: Array  # (m, 6), as `ContactLaw` names them


class ChainState(NamedTuple):
    """State of a chain, changed in place."""

    p: Array  # (n,), N
    q: Array  # (n,), N
    compression_m: Array  # (m,)
    most_m: Array  # (m,), largest compression
    force_n: Array  # (m,), mean over the last step
    work_j: Array  # (m,), done on each contact
    mass_speed: Array  # (1,)
    rod_loss_j: Array  # (1,)


@borrowing_kernel
def contact_law_of(chain: Chain, contact: int) -> ContactLaw:
    """Return the law of a contact."""
    row = chain.laws[contact]
    return ContactLaw(int(row[0]), row[1], row[2], row[3], row[4], row[5])


def wave_speed(young_modulus_pa: float, density_kg_per_m3: float) -> float:
    """Return c = sqrt(E/rho), m/s."""
    return math.sqrt(young_modulus_pa / density_kg_per_m3)


def chain_of(
    rods: list[list[Section]], laws: list[ContactLaw], gaps_m: list[float], span_s: float, mass_kg: float = 0.0
) -> tuple[Chain, ChainState]:
    """Return a chain at rest.

    Parameters
    ----------
    rods : list of lists of `Section`
        From left to right.
    laws, gaps_m : list
        One more than rods: left end (or the mass's contact), between the rods, wall; gaps in m.
    span_s : float
        Transit time of a cell, s.
    mass_kg : float
        Rigid mass at the left end; 0 for none, with a left end that is free.
    """
    sections = [section for rod in rods for section in rod]
    counts = [section.cells for section in sections]
    z = np.repeat([section.impedance for section in sections], counts).astype(float)
    reflection = np.zeros(len(z))
    reflection[1:] = (z[:-1] - z[1:]) / (z[:-1] + z[1:])
    starts = np.cumsum([0] + [sum(section.cells for section in rod) for rod in rods]).astype(np.int64)
    chain = Chain(
        float(span_s),
        float(mass_kg),
        z,
        np.repeat([section.area_m2 for section in sections], counts).astype(float),
        reflection,
        np.repeat([section.loss for section in sections], counts).astype(float),
        starts,
        np.array(laws, dtype=float),
    )
    m, n = len(laws), len(z)
    state = ChainState(
        np.zeros(n), np.zeros(n), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(1), np.zeros(1)
    )
    state.compression_m[:] = -np.array(gaps_m, dtype=float)
    state.most_m[:] = [law.threshold_n / law.unloading for law in laws]
    return chain, state


@borrowing_kernel
def set_speed(chain: Chain, state: ChainState, first: int, last: int, speed: float) -> None:
    """Set cells first to last - 1 to a speed (m/s) without stress."""
    for i in range(first, last):
        state.p[i] = 0.5 * chain.impedance[i] * speed
        state.q[i] = -state.p[i]


@borrowing_kernel
def find_contact_force(chain: Chain, state: ChainState, contact: int) -> None:
    """Find the mean force of a contact over the next step and book its work."""
    at, cells = chain.starts[contact], len(chain.impedance)
    closing = yielding = 0.0
    if at > 0:
        closing, yielding = 2.0 * state.p[at - 1] / chain.impedance[at - 1], 1.0 / chain.impedance[at - 1]
    elif chain.mass_kg > 0.0:
        closing, yielding = state.mass_speed[0], 0.5 * chain.span_s / chain.mass_kg
    if at < cells:
        closing += 2.0 * state.q[at] / chain.impedance[at]
        yielding += 1.0 / chain.impedance[at]
    law, start = contact_law_of(chain, contact), state.compression_m[contact]
    force, change = force_of_step(law, state.most_m[contact], start, closing, yielding, chain.span_s)
    state.force_n[contact] = force
    state.work_j[contact] += force * change
    state.compression_m[contact] = start + change
    if yields(law):
        state.most_m[contact] = max(state.most_m[contact], start + change)


@borrowing_kernel
def move_waves(chain: Chain, state: ChainState, left: int) -> None:
    """Move the waves of the rod right of a contact on by one cell."""
    p, q, z = state.p, state.q, chain.impedance
    first, last = chain.starts[left], chain.starts[left + 1] - 1
    before = p[first]
    p[first] = state.force_n[left] - q[first]
    for i in range(first, last):
        after = p[i + 1]
        jump = chain.reflection[i + 1] * (q[i + 1] - before)
        p[i + 1] = before + jump
        q[i] = q[i + 1] + jump
        before = after
    q[last] = state.force_n[left + 1] - before
    for i in range(first, last + 1):
        if chain.loss[i] > 0.0:
            taken = 0.5 * chain.loss[i] * (p[i] + q[i])
            held = p[i] * p[i] + q[i] * q[i]
            p[i] -= taken
            q[i] -= taken
            state.rod_loss_j[0] += (held - p[i] * p[i] - q[i] * q[i]) * chain.span_s / z[i]


@borrowing_kernel
def advance(chain: Chain, state: ChainState) -> None:
    """Advance a chain by one step of time, the transit time of a cell."""
    contacts = len(chain.starts)
    for contact in range(contacts):
        find_contact_force(chain, state, contact)
    if chain.mass_kg > 0.0:
        state.mass_speed[0] -= state.force_n[0] * chain.span_s / chain.mass_kg
    for left in range(contacts - 1):
        move_waves(chain, state, left)


@borrowing_kernel
def rod_energy(chain: Chain, state: ChainState, first: int, last: int) -> float:
    """Return the energy (J) in cells first to last - 1."""
    found = 0.0
    for i in range(first, last):
        found += (state.p[i] * state.p[i] + state.q[i] * state.q[i]) / chain.impedance[i]
    return float(found * chain.span_s)


@borrowing_kernel
def rod_momentum(chain: Chain, state: ChainState, first: int, last: int) -> float:
    """Return the momentum (N s) of cells first to last - 1."""
    found = 0.0
    for i in range(first, last):
        found += state.p[i] - state.q[i]
    return float(found * chain.span_s)


@borrowing_kernel
def rod_mass(chain: Chain, first: int, last: int) -> float:
    """Return the mass (kg) of cells first to last - 1: each has the momentum Z h v."""
    found = 0.0
    for i in range(first, last):
        found += chain.impedance[i]
    return float(found * chain.span_s)


@borrowing_kernel
def total_energy(chain: Chain, state: ChainState) -> float:
    """Return the energy (J) of mass and rods, the elastic energy of the contacts, and all that was lost."""
    found = 0.5 * chain.mass_kg * state.mass_speed[0] ** 2 + state.rod_loss_j[0]
    for contact in range(len(chain.starts)):
        found += state.work_j[contact]
    return float(found + rod_energy(chain, state, 0, len(chain.impedance)))


@borrowing_kernel
def contact_loss(chain: Chain, state: ChainState, contact: int) -> float:
    """Return the energy lost in a contact or wall (J): its work less the elastic energy that it still gives back.

    A damped wall that no longer follows the tool keeps its elastic energy.
    """
    if state.force_n[contact] == 0.0:
        return float(state.work_j[contact])
    law = contact_law_of(chain, contact)
    return float(state.work_j[contact] - stored(law, state.most_m[contact], state.compression_m[contact]))
