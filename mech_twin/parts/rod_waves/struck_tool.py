# SPDX-License-Identifier: Apache-2.0
"""A striker on a tool that stands on a wall: the chain of its rods, one blow, and what its gauge sees.

The striker is a rigid mass, with a rod as its head where it has one; the head's mass is part of the striker's.
"""

from collections.abc import Callable

import numpy as np

from mech_twin.kernels.kernel import kernel
from mech_twin.parts.rod_waves.blow import RodBlow, Window, simulate_blow
from mech_twin.parts.rod_waves.chain import Array, Chain, ChainState, set_speed
from mech_twin.parts.rod_waves.contact_law import BOND, LAW_COLUMNS
from mech_twin.parts.rod_waves.fatigue import StressLine, blow_damage
from mech_twin.parts.rod_waves.parameters import GridPiece, WaveGrid

# simulates a blow; rooms for both waves at the gauge and for the forces
BlowSimulation = Callable[[Array, Array], RodBlow]
NO_CURVE, NO_FORCES = np.empty((0, 2)), np.empty((0, 1))
LARGEST_HEAD = 0.9  # of the striker's mass: the rest moves it as a rigid body


@kernel
def empty_chain(grid: WaveGrid, striker_kg: float) -> Chain:
    """Return striker, tool, foot and wall as a chain."""
    head, tool = grid.head.cells, grid.rod.cells + grid.tip.cells
    n = head + tool + grid.foot.cells
    z, area, reflection, loss = np.empty(n), np.empty(n), np.zeros(n), np.empty(n)
    at = 0
    for piece in (grid.head, grid.rod, grid.tip, grid.foot):
        for _ in range(piece.cells):
            z[at], area[at], loss[at] = piece.impedance, piece.area_m2, piece.loss
            at += 1
    for i in range(1, n):
        reflection[i] = (z[i - 1] - z[i]) / (z[i - 1] + z[i])
    struck = 1 if head > 0 else 0
    contacts = struck + (3 if grid.foot.cells > 0 else 2)
    starts, laws = np.empty(contacts, dtype=np.int64), np.empty((contacts, LAW_COLUMNS))
    starts[0], starts[struck], starts[contacts - 1] = 0, head, n
    if grid.foot.cells > 0:
        starts[struck + 1] = head + tool
    for contact in range(contacts):
        law = grid.seat
        if contact < struck:
            law = BOND
        elif contact == struck:
            law = grid.face
        elif contact == contacts - 1:
            law = grid.wall
        laws[contact, 0], laws[contact, 1], laws[contact, 2] = law.kind, law.loading, law.unloading
        laws[contact, 3], laws[contact, 4], laws[contact, 5] = law.threshold_n, law.exponent, law.damping
    return Chain(grid.span_s, striker_kg - head_mass(grid), z, area, reflection, loss, starts, laws)


@kernel
def head_mass(grid: WaveGrid) -> float:
    """Return the mass of the striker's head (kg)."""
    return grid.head.cells * grid.head.impedance * grid.span_s


@kernel
def with_head_within(grid: WaveGrid, striker_kg: float) -> WaveGrid:
    """Return the grid; without the head where that is more than `LARGEST_HEAD` of the striker's mass."""
    head, none = grid.head, GridPiece(0, 1.0, 1.0, 0.0, 0.0)
    return WaveGrid(
        grid.span_s, head if head_mass(grid) <= LARGEST_HEAD * striker_kg else none, grid.rod, grid.tip, grid.foot,
        grid.face, grid.seat, grid.wall, grid.foot_gap_m, grid.unseated_gap_m, grid.gauge, grid.window_s,
    )  # fmt: skip


@kernel
def state_before(grid: WaveGrid, chain: Chain, closing: float, tool_speed: float, seated: bool) -> ChainState:
    """Return the chain at the first touch; a tool that moves already has the wall yielding before it."""
    n, m, head = len(chain.impedance), len(chain.starts), grid.head.cells
    state = ChainState(
        np.zeros(n), np.zeros(n), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(1), np.zeros(1)
    )
    for contact in range(m):
        state.most_m[contact] = chain.laws[contact, 3] / chain.laws[contact, 2]
    if grid.foot.cells > 0 and tool_speed == 0.0:
        state.compression_m[m - 2] = -grid.foot_gap_m
    if not seated and tool_speed == 0.0:
        state.compression_m[m - 1] = -grid.unseated_gap_m
    elif tool_speed > 0.0:
        state.compression_m[m - 1] = state.most_m[m - 1]
    state.mass_speed[0] = tool_speed + closing
    set_speed(chain, state, 0, head, tool_speed + closing)
    set_speed(chain, state, head, n, tool_speed)
    return state


@kernel
def rod_blow(
    grid: WaveGrid, striker_kg: float, closing: float, tool_speed: float, seated: bool, gauge: Array, forces: Array
) -> RodBlow:
    """Return the blow of a striker on the tool; ``gauge`` and ``forces`` as in `simulate_blow`, a row a step."""
    chain = empty_chain(grid, striker_kg)
    state = state_before(grid, chain, closing, tool_speed, seated)
    idle, head = np.zeros(len(chain.starts)), grid.head.cells
    window = Window(1 if head > 0 else 0, head + grid.gauge, grid.window_s)
    return simulate_blow(chain, state, window, idle, gauge, forces, 1)


def place_m(grid: WaveGrid, transit_s: float) -> float:
    """Return the distance from the struck face (m) of a place, from its transit time; negative in the head."""
    transit_s -= grid.head.cells * grid.span_s
    if transit_s < 0.0:
        return transit_s / (grid.head.cells * grid.span_s) * grid.head.length_m
    along = 0.0
    for piece in (grid.rod, grid.tip, grid.foot):
        share = min(1.0, transit_s / (piece.cells * grid.span_s)) if piece.cells else 0.0
        along += share * piece.length_m
        transit_s -= share * piece.cells * grid.span_s
    return along


def gauge_piece(grid: WaveGrid) -> GridPiece:
    """Return the piece of the tool that carries the gauge."""
    return grid.rod if grid.gauge < grid.rod.cells else grid.tip


def strain_per_n(grid: WaveGrid) -> float:
    """Return strain over force at the gauge, 1/(E A) = 1/(Z c)."""
    piece = gauge_piece(grid)
    return piece.cells * grid.span_s / (piece.impedance * piece.length_m)


def gauge_numbers(grid: WaveGrid, found: RodBlow) -> tuple[float, ...]:
    """Return the gauge's numbers of a blow, in the order of `GAUGE_UNITS`."""
    energies = found.incident_energy_j, found.forward_energy_j, found.reflected_energy_j
    return *energies, found.gauge_peak_n, found.gauge_peak_n * strain_per_n(grid), found.gauge_tension_n


def rod_numbers(grid: WaveGrid, found: RodBlow) -> dict[str, float]:
    """Return the numbers of a blow for rods, contacts and wall, by name with unit."""
    return {
        "incident_energy_j": found.incident_energy_j,
        "transmitted_energy_j": found.transmitted_energy_j,
        "forward_energy_j": found.forward_energy_j,
        "reflected_energy_j": found.reflected_energy_j,
        "penetration_m": found.penetration_m,
        "peak_force_n": found.peak_force_n,
        "wall_peak_force_n": found.wall_peak_force_n,
        "peak_stress_pa": found.peak_stress_pa,
        "stress_place_m": place_m(grid, found.peak_stress_at_s),
        "peak_tension_pa": found.peak_tension_pa,
        "tension_place_m": place_m(grid, found.peak_tension_at_s),
        "blow_contact_time_s": found.contact_time_s,
        "blow_contacts": float(found.contacts),
        "blow_efficiency": found.transmitted_energy_j / found.striker_energy_j,
        "tool_energy_j": 0.5 * found.tool_momentum_ns**2 / grid.tool_mass_kg,
        "tool_vibration_j": found.tool_vibration_j,
        "contact_loss_j": found.contact_loss_j,
        "blow_window_s": found.duration_s,
        "blow_unended": 0.0 if found.parted else 1.0,
    }


def force_room(grid: WaveGrid) -> Array:
    """Return room for the force in each cell over the longest blow."""
    cells = grid.head.cells + grid.rod.cells + grid.tip.cells + grid.foot.cells
    return np.zeros((int(grid.window_s / grid.span_s) + 1, cells))


def life_numbers(grid: WaveGrid, line: StressLine, found: RodBlow, forces: Array) -> dict[str, float]:
    """Return the damage that a blow does to head, tool or foot, where, and how many such blows make 1.

    It is at most 1: the first blow breaks the rod.
    """
    pieces = (grid.head, grid.rod, grid.tip, grid.foot)
    area = np.repeat([piece.area_m2 for piece in pieces], [piece.cells for piece in pieces]).astype(np.float64)
    damage, cell = blow_damage(line, forces[: found.steps], area)
    damage, place = min(damage, 1.0), place_m(grid, (cell + 0.5) * grid.span_s)
    return {"damage_per_blow": damage, "damage_place_m": place, "life_blows": 1.0 / damage if damage > 0.0 else 0.0}


def gauge_curve(grid: WaveGrid, simulate: BlowSimulation) -> tuple[float, Array, Array]:
    """Return span (s), force (N) and strain at the gauge over a blow, a number each step of the grid."""
    room = np.zeros((int(grid.window_s / grid.span_s) + 1, 2))
    force = room[: simulate(room, NO_FORCES).steps].sum(axis=1)
    return grid.span_s, force, strain_per_n(grid) * force


def blow_and_metrics(
    grid: WaveGrid, line: StressLine | None, simulate: BlowSimulation
) -> tuple[RodBlow, dict[str, float]]:
    """Return a blow and its metrics of rods, contacts and wall; of its life where an S-N line is given."""
    forces = NO_FORCES if line is None else force_room(grid)
    found = simulate(NO_CURVE, forces)
    return found, {**rod_numbers(grid, found), **({} if line is None else life_numbers(grid, line, found, forces))}
