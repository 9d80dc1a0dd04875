# SPDX-License-Identifier: Apache-2.0
"""One blow through a chain of rods: led until striker and tool have parted for good and the wall is quiet.

The striker is the mass, with the rods left of contact ``struck``; the tool is all that lies right of it.
Energy by the rule for tools of hydraulic breakers: E = (1/Z) int F^2 dt at a gauge, over the first compressive wave
(AemToolEnergy).

The share of energy that a linear wall takes from the first wave of a long rod has closed forms.  The wall keeps its
largest work, as with a rigid unloading.  Both forms follow from Z u' + k u = 2 p with the incident wave p of the
striker (LundbergPercussive1982).
"""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.parts.rod_waves.chain import (
    Chain,
    ChainState,
    Section,
    advance,
    chain_of,
    contact_law_of,
    contact_loss,
    rod_energy,
    rod_mass,
    rod_momentum,
    set_speed,
    total_energy,
)
from mech_twin.parts.rod_waves.contact_law import FREE_END, PIECEWISE, RIGID_FACE, linear_contact, permanent

Array = NDArray[np.float64]
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


class Window(NamedTuple):
    """What is looked at, and for how long at most."""

    struck: int  # contact of striker and tool
    gauge: int  # cell
    limit_s: float


class RodBlow(NamedTuple):
    """Results of a blow, SI units; stresses positive in compression, places from the left end of the chain."""

    impulse_ns: float  # on the striker, and on the tool
    striker_momentum_ns: float
    tool_momentum_ns: float
    tool_travel_m: float  # mean over its mass
    striker_energy_j: float  # kinetic, before
    incident_energy_j: float
    forward_energy_j: float  # through the gauge, every pass counted
    reflected_energy_j: float  # back through the gauge, every pass counted
    transmitted_energy_j: float  # kept by the wall
    wall_peak_work_j: float
    penetration_m: float  # permanent
    wall_peak_force_n: float
    peak_force_n: float  # of the striker
    gauge_peak_n: float  # at the gauge, compression
    gauge_tension_n: float  # at the gauge, tension
    peak_stress_pa: float
    peak_stress_at_s: float  # transit time from the left end to the place
    peak_tension_pa: float
    peak_tension_at_s: float
    contact_time_s: float
    contacts: int
    tool_vibration_j: float
    striker_vibration_j: float
    contact_loss_j: float  # of the contacts but the wall
    rod_loss_j: float
    energy_error: float  # of the energy at the beginning
    duration_s: float
    steps: int
    parted: bool  # before the limit


@borrowing_kernel
def mean_speed(chain: Chain, state: ChainState, left: int) -> float:
    """Return the mean speed (m/s) of the rod right of a contact."""
    first, last = chain.starts[left], chain.starts[left + 1]
    return rod_momentum(chain, state, first, last) / rod_mass(chain, first, last)


@borrowing_kernel
def has_parted(chain: Chain, state: ChainState, window: Window, idle: Array, quiet: int) -> bool:
    """Return whether nothing right of the striker will meet again: open for a round trip, and not closing.

    A wall that yields at a constant force is never quiet: it is left out.
    """
    contacts = len(chain.starts)
    for contact in range(window.struck, contacts):
        wall = contact == contacts - 1
        law = contact_law_of(chain, contact)
        if wall and law.kind == PIECEWISE and law.loading == 0.0:
            continue
        if idle[contact] < quiet:
            return False
        if wall:
            if law.kind != 0 and mean_speed(chain, state, contact - 1) > 0.0:
                return False
            continue
        right = mean_speed(chain, state, contact)
        if contact > window.struck:
            left = mean_speed(chain, state, contact - 1)
        else:
            first = chain.starts[contact]
            if first == 0 and chain.mass_kg == 0.0:
                continue  # a rod without a striker
            momentum = chain.mass_kg * state.mass_speed[0] + rod_momentum(chain, state, 0, first)
            left = momentum / (chain.mass_kg + rod_mass(chain, 0, first))
        if left > right:
            return False
    return True


@borrowing_kernel
def stress_extremes(chain: Chain, state: ChainState, extremes: Array) -> None:
    """Update the largest compression and tension (Pa), and the cells where they occurred; a contact is at i - 0.5."""
    for contact in range(len(chain.starts)):
        at = chain.starts[contact]
        for i in range(max(at - 1, 0), min(at + 1, len(chain.area_m2))):
            stress = state.force_n[contact] / chain.area_m2[i]
            if stress > extremes[0]:
                extremes[0], extremes[1] = stress, at - 0.5
    for i in range(len(chain.impedance)):
        stress = (state.p[i] + state.q[i]) / chain.area_m2[i]
        if stress > extremes[0]:
            extremes[0], extremes[1] = stress, i
        if stress < extremes[2]:
            extremes[2], extremes[3] = stress, i


@kernel
def simulate_blow(
    chain: Chain, state: ChainState, window: Window, idle: Array, gauge: Array, forces: Array, stride: int
) -> RodBlow:
    """Simulate a blow to its end; the state is changed in place.

    Parameters
    ----------
    chain, state : Chain, ChainState
        With the speeds of striker and tool set.
    window : Window
        Contact, gauge, longest duration.
    idle : (m,) array
        Room to work.
    gauge : (k, 2) array
        Receives p and q (N) at the gauge of the first k steps.
    forces : (j, n) array
        Receives the force in each cell (N), every ``stride`` steps.
    """
    contacts, cells, h = len(chain.starts), len(chain.impedance), chain.span_s
    first = chain.starts[window.struck]
    striker_ns = chain.mass_kg * state.mass_speed[0] + rod_momentum(chain, state, 0, first)
    striker_j = 0.5 * chain.mass_kg * state.mass_speed[0] ** 2 + rod_energy(chain, state, 0, first)
    mass, energy = rod_mass(chain, first, cells), total_energy(chain, state)
    momentum, quiet = rod_momentum(chain, state, first, cells), 2 * cells
    impulse = travel = incident = forward = back = peak = touching = wall_peak = wall_work = 0.0
    pressed = pulled = 0.0
    extremes = np.zeros(4)
    met, rising, steps, parted = 0, 0, 0, False
    idle[:] = 0.0
    for step in range(max(1, int(window.limit_s / h))):
        was = state.force_n[window.struck]
        advance(chain, state)
        steps += 1
        force, wall = state.force_n[window.struck], state.force_n[contacts - 1]
        met += 1 if force > 0.0 and (step == 0 or was <= 0.0) else 0
        touching += h if force > 0.0 else 0.0
        peak, wall_peak = max(peak, force), max(wall_peak, wall)
        wall_work = max(wall_work, state.work_j[contacts - 1])
        impulse += force * h
        travel += 0.5 * h * (2.0 * momentum + (force - wall) * h) / mass
        momentum += (force - wall) * h
        p, q = state.p[window.gauge], state.q[window.gauge]
        through = p + q
        pressed, pulled = max(pressed, through), max(pulled, -through)
        if rising == 0 and through > 1e-9 * peak:
            rising = 1
        if rising == 1 and through <= 1e-9 * peak:
            rising = 2
        z = chain.impedance[window.gauge]
        incident += through * through * h / z if rising == 1 else 0.0
        forward += p * p * h / z
        back += q * q * h / z
        if step < len(gauge):
            gauge[step, 0], gauge[step, 1] = p, q
        if step % stride == 0 and step // stride < len(forces):
            for i in range(cells):
                forces[step // stride, i] = state.p[i] + state.q[i]
        stress_extremes(chain, state, extremes)
        for contact in range(contacts):
            idle[contact] = 0.0 if state.force_n[contact] > 0.0 else idle[contact] + 1.0
        if step % 8 == 0 and has_parted(chain, state, window, idle, quiet):
            parted = True
            break
    left = striker_ns - impulse
    moved = chain.mass_kg + rod_mass(chain, 0, first)
    kept = 0.0
    for contact in range(contacts - 1):
        kept += contact_loss(chain, state, contact)
    striker_left = 0.5 * chain.mass_kg * state.mass_speed[0] ** 2 + rod_energy(chain, state, 0, first)
    last = contacts - 1
    return RodBlow(
        impulse,
        left,
        momentum,
        travel,
        striker_j,
        incident,
        forward,
        back,
        contact_loss(chain, state, last),
        wall_work,
        permanent(contact_law_of(chain, last), state.most_m[last]),
        wall_peak,
        peak,
        pressed,
        pulled,
        extremes[0],
        (extremes[1] + 0.5) * h,
        -extremes[2],
        (extremes[3] + 0.5) * h,
        touching,
        met,
        rod_energy(chain, state, first, cells) - 0.5 * momentum * momentum / mass,
        striker_left - 0.5 * left * left / moved if moved > 0.0 else 0.0,
        kept,
        state.rod_loss_j[0],
        total_energy(chain, state) / energy - 1.0,
        steps * h,
        steps,
        parted,
    )


def share_of_rectangle(x: float) -> float:
    """Return 2 (1 - exp(-x))^2/x, x = 2 L k/(c Z): a striker that is a rod of length L and the tool's impedance."""
    return 2.0 * math.expm1(-x) * math.expm1(-x) / x


def share_of_mass(a: float) -> float:
    """Return 4 a a^(-2 a/(a - 1)), a = k M/Z^2: a rigid striker of mass M; 4/e^2 at a = 1."""
    if abs(a - 1.0) < 1e-9:
        return 4.0 * math.exp(-2.0)
    return float(4.0 * a * a ** (-2.0 * a / (a - 1.0)))


def simulated_share_of_rectangle(x: float, cells: int = CELLS) -> float:
    """Return the share of the rod as a striker, led on a grid of so many cells a striker."""
    return simulated_share_of_steps(((1.0, 1.0),), x, cells)


def simulated_share_of_steps(steps: Steps, x: float, cells: int = CELLS) -> float:
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
    return _simulated_share(chain, state, 1, 15.9)


def simulated_share_of_mass(a: float, cells: int = CELLS) -> float:
    """Return the share of the rigid striker, led on a grid of so many cells a unit of time M/Z."""
    chain, state = chain_of(
        [[UNIT._replace(cells=8 * cells)]], [RIGID_FACE, linear_contact(a)], [0.0, 0.0], 1.0 / cells, 1.0
    )
    state.mass_speed[0] = 1.0
    return _simulated_share(chain, state, 0, 15.9)


def _simulated_share(chain: Chain, state: ChainState, struck: int, limit_s: float) -> float:
    none = np.zeros((0, 2))
    room = np.zeros(len(chain.starts))
    found = simulate_blow(chain, state, Window(struck, 0, limit_s), room, none, np.zeros((0, 1)), 1)
    return float(found.wall_peak_work_j / found.striker_energy_j)
