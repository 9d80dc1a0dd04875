# SPDX-License-Identifier: Apache-2.0
"""Blows whose waves have a closed form: efficiencies, pulses, momentum, and what the grid leaves of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mech_twin.parts.rod_waves.blow import RodBlow, Window, simulate_blow
from mech_twin.parts.rod_waves.chain import Chain, ChainState, Section, chain_of, set_speed
from mech_twin.parts.rod_waves.contact_law import (
    FREE_END,
    RIGID_FACE,
    ContactLaw,
    hertz_contact,
    linear_contact,
    power_wall,
    yielding_wall,
)

Z, AREA, SPEED = 4.0e4, 1.0e-3, 7.0  # N s/m, m2, m/s


def led(chain: Chain, state: ChainState, limit_s: float, struck: int = 0, gauge: int = 0) -> tuple[RodBlow, np.ndarray]:
    log = np.zeros((int(limit_s / chain.span_s), 2))
    idle, none = np.zeros(len(chain.starts)), np.zeros((0, len(chain.impedance)))
    found = simulate_blow(chain, state, Window(struck, gauge, limit_s), idle, log, none, 1)
    return found, log[: found.steps]


def equal_rods(cells: int, tool: int, wall: ContactLaw) -> tuple[Chain, ChainState]:
    """Return a rod of 1e-4 s that meets a long one of equal impedance."""
    rods = [[Section(cells, Z, AREA, 0.0)], [Section(tool, Z, AREA, 0.0)]]
    chain, state = chain_of(rods, [FREE_END, RIGID_FACE, wall], [0.0] * 3, 1e-4 / cells)
    set_speed(chain, state, 0, cells, SPEED)
    return chain, state


def mass_on_rod(
    mass: float, cells: int, span: float, wall: ContactLaw, face: ContactLaw = RIGID_FACE
) -> tuple[Chain, ChainState]:
    chain, state = chain_of([[Section(cells, Z, AREA, 0.0)]], [face, wall], [0.0] * 2, span, mass)
    state.mass_speed[0] = SPEED
    return chain, state


def first_pass_efficiency(x: float, cells: int) -> float:
    """Return the wall's work over the striker's energy before the tool's reflected wave can come back."""
    pulse = 2e-4
    chain, state = equal_rods(cells, 4 * cells, linear_contact(x * Z / pulse))
    found, _ = led(chain, state, 1.9 * pulse + 4e-4, struck=1)
    return found.wall_peak_work_j / found.striker_energy_j


@pytest.mark.parametrize("x", [0.3, 1.0, 1.25643, 3.0])
def test_a_rectangular_wave_gives_a_linear_wall_its_share(x: float) -> None:
    """2 (1 - exp(-x))^2/x of the energy enters the wall in the first pass, x = 2 L k/(c Z)."""
    assert first_pass_efficiency(x, 1000) == pytest.approx(2.0 * (1.0 - math.exp(-x)) ** 2 / x, rel=2e-7)


@pytest.mark.slow
def test_the_best_wall_for_a_rectangular_wave_takes_0_81453() -> None:
    """The share is greatest at x = 1.25643."""
    best = first_pass_efficiency(1.25643, 1000)
    assert best == pytest.approx(0.81453, abs=5e-6)
    assert best > max(first_pass_efficiency(1.25643 + d, 1000) for d in (-0.02, 0.02))


@pytest.mark.parametrize(
    ("a", "share"), [(0.5, 0.5), (2.0, 0.5), (1.0, 0.54134), (4.0, 4.0 * 4.0 ** (1.0 - 8.0 / 3.0))]
)
def test_a_rigid_mass_on_a_long_rod_gives_a_linear_wall_its_share(a: float, share: float) -> None:
    """4 a a^(-2a/(a-1)) of the energy, a = k M/Z^2; at a = 1 its limit 4/e^2 = 0.54134."""
    mass = 8.0
    scale = mass / Z
    cells = 8000
    chain, state = mass_on_rod(mass, cells, 8.0 * scale / cells, linear_contact(a * Z * Z / mass))
    found, _ = led(chain, state, 15.9 * scale)
    got = found.wall_peak_work_j / found.striker_energy_j
    assert got == pytest.approx(share, abs=5e-6)
    exact = 4.0 / math.e**2 if a == 1.0 else 4.0 * a * a ** (-2.0 * a / (a - 1.0))
    assert got == pytest.approx(exact, rel=3e-6)


def test_a_rigid_mass_sends_an_exponential_wave_into_a_long_rod() -> None:
    """The force at its face is Z v exp(-Z t/M); its incident energy tends to M v^2/2."""
    mass, cells = 8.0, 8000
    scale = mass / Z
    chain, state = mass_on_rod(mass, cells, 20.0 * scale / cells, FREE_END)
    found, log = led(chain, state, 19.5 * scale)
    time = (np.arange(len(log)) + 0.5) * chain.span_s
    assert log[:, 0] == pytest.approx(Z * SPEED * np.exp(-Z * time / mass), abs=2e-6 * Z * SPEED)
    assert found.incident_energy_j == pytest.approx(0.5 * mass * SPEED**2, rel=1e-12)


def test_equal_rods_pass_on_all_momentum() -> None:
    """The striker stays at rest, the tool goes on with its speed; the stress between them is rho c v/2."""
    chain, state = equal_rods(50, 50, FREE_END)
    found, _ = led(chain, state, 1e-2, struck=1)
    momentum = Z * 1e-4 * SPEED
    assert found.parted
    assert found.tool_momentum_ns == pytest.approx(momentum, rel=1e-13)
    assert abs(found.striker_momentum_ns) < 1e-13 * momentum
    assert found.striker_vibration_j + found.tool_vibration_j < 1e-13 * found.striker_energy_j
    assert found.peak_stress_pa == pytest.approx(Z / AREA * SPEED / 2.0, rel=1e-14)
    assert found.contact_time_s == pytest.approx(2e-4, rel=1e-12)


@pytest.mark.parametrize("wall", [yielding_wall(500.0, 5e9), linear_contact(5e7, 0.5), linear_contact(5e8, 0.5)])
def test_no_contact_presses_harder_than_the_largest_stress(wall: ContactLaw) -> None:
    """Peak force over area is a stress of the rod, at its end; few cells find it as well as many."""
    peaks = []
    for cells in (32, 1024):
        chain, state = mass_on_rod(100.0, cells, 8.7e-5 / cells, wall, linear_contact(2e8))
        found, _ = led(chain, state, 2e-2)
        assert found.peak_stress_pa >= max(found.peak_force_n, found.wall_peak_force_n) / AREA
        peaks.append(found.peak_stress_pa)
    assert peaks[0] == pytest.approx(peaks[1], rel=1e-3)


def test_a_short_striker_rebounds_from_a_rigid_wall_with_its_speed() -> None:
    """A rod that meets a rigid wall parts from it after 2 L/c with all its speed; stress rho c v."""
    chain, state = chain_of([[Section(40, Z, AREA, 0.0)]], [FREE_END, RIGID_FACE], [0.0, 0.0], 1e-6)
    set_speed(chain, state, 0, 40, SPEED)
    found, _ = led(chain, state, 3e-4)
    assert found.wall_peak_force_n == pytest.approx(Z * SPEED, rel=1e-14)
    assert found.tool_momentum_ns == pytest.approx(-Z * 40e-6 * SPEED, rel=1e-13)


def test_a_compressive_wave_comes_back_from_a_free_end_as_tension() -> None:
    """Blank firing: the tension behind a reflected rectangular wave is the compression before it."""
    chain, state = equal_rods(50, 400, FREE_END)
    found, log = led(chain, state, 1.5e-3, struck=1, gauge=250)
    force = log.sum(axis=1)
    assert force.max() == pytest.approx(0.5 * Z * SPEED, rel=1e-14)
    assert force.min() == pytest.approx(-0.5 * Z * SPEED, rel=1e-14)
    assert found.incident_energy_j == pytest.approx(found.striker_energy_j, rel=1e-12)


def test_a_change_of_section_passes_on_2_z2_over_z1_plus_z2() -> None:
    """The force transmitted into a thinner rod, and the reflected one."""
    rods = [[Section(20, Z, AREA, 0.0)], [Section(100, Z, AREA, 0.0), Section(100, 0.25 * Z, 0.25 * AREA, 0.0)]]
    for gauge, wanted in ((150, 2.0 * 0.25 / 1.25), (50, 1.0)):
        chain, state = chain_of(rods, [FREE_END, RIGID_FACE, FREE_END], [0.0] * 3, 1e-6)
        set_speed(chain, state, 0, 20, SPEED)
        _, log = led(chain, state, 1.95e-4, struck=1, gauge=gauge)
        assert log[:, 0].max() == pytest.approx(wanted * 0.5 * Z * SPEED, rel=1e-14)
        if gauge == 50:
            assert log[:, 1].min() == pytest.approx((0.25 - 1.0) / 1.25 * 0.5 * Z * SPEED, rel=1e-14)


WALLS = {
    "elastic": linear_contact(3e8),
    "loading and unloading": ContactLaw(3, 1e8, 4e8, 0.0),
    "threshold": ContactLaw(3, 5e7, 4e8, 3e4),
    "yielding": yielding_wall(5e4, 1e9),
    "rigid": RIGID_FACE,
    "free": FREE_END,
    "hertz": hertz_contact(1.15e11, 0.05),
    "stiffening": power_wall(1e8, 1.8, 1e-3, 3.0),
    "softening": power_wall(1e8, 0.6, 1e-3, 2.0),
    "damped": ContactLaw(3, 1e8, 4e8, 0.0, 1.0, 2e4),
    "damped, stiffening": power_wall(1e8, 1.5, 1e-3, 1.25)._replace(damping=1e4),
}


@pytest.mark.parametrize("wall", WALLS)
@pytest.mark.parametrize("face", ["elastic", "loading and unloading", "hertz"])
def test_energy_closes_at_every_blow(wall: str, face: str) -> None:
    """Striker, rods, contacts, wall and loss hold together what the striker brought, to 1e-12."""
    rods = [
        [Section(9, 1.3 * Z, 1.3 * AREA, 0.0)],
        [Section(40, Z, AREA, 2e-3), Section(15, 0.6 * Z, 0.6 * AREA, 2e-3)],
        [Section(6, 2.0 * Z, 2.0 * AREA, 0.0)],
    ]
    laws = [ContactLaw(2, 0.0, 1.0, 0.0), WALLS[face], linear_contact(1e9), WALLS[wall]]
    chain, state = chain_of(rods, laws, [0.0, 0.0, 1e-4, 2e-4], 2e-6, 5.0)
    state.mass_speed[0] = SPEED
    set_speed(chain, state, 0, 9, SPEED)
    found, _ = led(chain, state, 2e-2, struck=1)
    assert abs(found.energy_error) < 1e-12
    kinetic = 0.5 * found.tool_momentum_ns**2 / (2e-6 * Z * (40 + 15 * 0.6 + 12))
    striker = 0.5 * found.striker_momentum_ns**2 / (5.0 + 2e-6 * 9 * 1.3 * Z)
    parts = (
        kinetic + striker + found.tool_vibration_j + found.striker_vibration_j + found.contact_loss_j + found.rod_loss_j
    )
    inside = found.striker_energy_j - parts - found.transmitted_energy_j  # elastic energy of what is not parted
    assert inside > -1e-12 * found.striker_energy_j
    if found.parted and wall != "yielding":
        assert inside == pytest.approx(0.0, abs=1e-12 * found.striker_energy_j)


@pytest.mark.parametrize("wall", ["elastic", "hertz"])
def test_an_elastic_wall_gives_back_what_it_took(wall: str) -> None:
    """After the blow nothing stays in it, and nothing is permanent."""
    chain, state = mass_on_rod(8.0, 30, 3e-6, WALLS[wall], linear_contact(5e8))
    found, _ = led(chain, state, 2e-2)
    assert found.parted
    assert abs(found.transmitted_energy_j) < 1e-12 * found.striker_energy_j
    assert found.penetration_m == 0.0


def test_the_wall_keeps_the_area_between_loading_and_unloading() -> None:
    """Work less elastic energy is u_m^2 k_l (1 - k_l/k_u)/2 on straight lines."""
    loading, unloading = 1e8, 4e8
    chain, state = mass_on_rod(8.0, 30, 3e-6, ContactLaw(3, loading, unloading, 0.0))
    found, _ = led(chain, state, 2e-2)
    deepest = found.penetration_m / (1.0 - loading / unloading)
    assert found.parted
    assert found.transmitted_energy_j == pytest.approx(
        0.5 * loading * deepest**2 * (1.0 - loading / unloading), rel=1e-10
    )


@pytest.mark.parametrize("exponent", [0.6, 1.5, 2.0])
def test_a_power_law_takes_a_stiff_mass_by_its_energy(exponent: float) -> None:
    """M v^2/2 = k u_1^2 (u_m/u_1)^(n + 1)/(n + 1); of it the unloading line gives back (n + 1)/(2 r)."""
    ratio, stiffness, at = 3.0, 1e7, 1e-3
    section = Section(1, 8.0 / 1e-7, AREA, 0.0)  # 8 kg that a wave crosses within 1e-7 s
    chain, state = chain_of([[section]], [FREE_END, power_wall(stiffness, exponent, at, ratio)], [0.0] * 2, 1e-7)
    set_speed(chain, state, 0, 1, SPEED)
    found, _ = led(chain, state, 1e-2)
    energy = 0.5 * 8.0 * SPEED**2
    deepest = at * (energy * (exponent + 1.0) / (stiffness * at * at)) ** (1.0 / (exponent + 1.0))
    assert found.penetration_m == pytest.approx((1.0 - 1.0 / ratio) * deepest, rel=1e-4)
    assert found.wall_peak_force_n == pytest.approx(stiffness * at * (deepest / at) ** exponent, rel=1e-4)
    assert found.transmitted_energy_j == pytest.approx(energy * (1.0 - (exponent + 1.0) / (2.0 * ratio)), rel=1e-4)


@pytest.mark.parametrize("share", [0.25, 1.0, 4.0])
def test_a_damper_reflects_by_its_impedance(share: float) -> None:
    """Behind a damper d alone a wave comes back as (d - Z)/(d + Z); d = Z takes all of it."""
    damper = ContactLaw(3, 1e-3, 1e-3, 0.0, 1.0, share * Z)
    chain, state = equal_rods(50, 200, damper)
    found, log = led(chain, state, 6.9e-4, struck=1, gauge=180)
    back = np.abs(log[:, 1]).max() / (0.5 * Z * SPEED)
    assert back == pytest.approx(abs(share - 1.0) / (share + 1.0), abs=1e-9)
    assert found.transmitted_energy_j == pytest.approx((1.0 - back**2) * found.striker_energy_j, rel=1e-9)


@pytest.mark.parametrize("zeta", [0.1, 0.4, 0.8])
def test_a_damped_wall_keeps_all_that_a_mass_does_not_take_away(zeta: float) -> None:
    """Spring and damper let go before the spring is relaxed: e = exp(-2 zeta acos(zeta)/sqrt(1 - zeta^2))."""
    mass, stiffness = 8.0, 1e7
    wall = ContactLaw(3, stiffness, stiffness, 0.0, 1.0, 2.0 * zeta * math.sqrt(stiffness * mass))
    chain, state = chain_of([[Section(1, mass / 1e-7, AREA, 0.0)]], [FREE_END, wall], [0.0] * 2, 1e-7)
    set_speed(chain, state, 0, 1, SPEED)
    found, _ = led(chain, state, 1e-2)
    restitution = math.exp(-2.0 * zeta * math.acos(zeta) / math.sqrt(1.0 - zeta**2))
    assert found.tool_momentum_ns == pytest.approx(-restitution * mass * SPEED, rel=1e-3)
    assert found.transmitted_energy_j == pytest.approx(0.5 * mass * SPEED**2 * (1.0 - restitution**2), rel=1e-3)


def smooth_blow(cells: int) -> RodBlow:
    chain, state = mass_on_rod(8.0, cells, 1e-4 / cells, ContactLaw(3, 2e8, 6e8, 0.0), hertz_contact(1.15e11, 0.05))
    return led(chain, state, 2e-2)[0]


def test_halving_the_cells_changes_energies_of_second_order() -> None:
    """Energies of a smooth pulse: below 1e-3 from 32 cells on, and four times less with each halving."""
    found = [smooth_blow(cells) for cells in (32, 64, 128, 256)]
    for name in ("transmitted_energy_j", "wall_peak_work_j"):
        values = [getattr(blow, name) / found[0].striker_energy_j for blow in found]
        steps = np.abs(np.diff(values))
        assert steps[0] < 1e-3
        assert np.log2(steps[:-1] / steps[1:]) == pytest.approx(2.0, abs=0.3), name


def rigid_limit(stiffness: float, restitution: float) -> tuple[float, float, float]:
    """Return restitution, and the tool's momentum over the rigid one, of a stiff short tool on a yielding wall."""
    mass, tool, force = 14.0, 10.0, 500.0
    span = 0.02 * math.sqrt(5.8 / stiffness)
    wall = yielding_wall(force, 1e-2 * stiffness)
    section = Section(1, tool / span, AREA, 0.0)
    chain, state = chain_of([[section]], [linear_contact(stiffness, restitution), wall], [0.0, 0.0], span, mass)
    state.mass_speed[0] = SPEED
    found, _ = led(chain, state, 6.0 * math.pi * math.sqrt(5.8 / stiffness))
    rigid = (1.0 + restitution) * SPEED * mass * tool / (mass + tool)
    after = (found.tool_momentum_ns / tool - found.striker_momentum_ns / mass) / SPEED
    overtravel = (found.tool_momentum_ns / rigid) ** 2  # of m w^2/(2 F), as the rigid tool goes on
    return after, found.tool_momentum_ns / rigid, overtravel


@pytest.mark.parametrize("restitution", [0.35, 0.8, 1.0])
def test_a_stiffening_contact_tends_to_the_rigid_blow(restitution: float) -> None:
    """Restitution and overtravel of the rigid model are the limit: the difference falls with 1/sqrt(k)."""
    rows = [rigid_limit(k, restitution) for k in (1e8, 1e10, 1e12)]
    for column, limit in ((0, restitution), (1, 1.0), (2, 1.0)):
        missed = [abs(row[column] - limit) for row in rows]
        assert missed[2] < 5e-3
        assert missed[0] > missed[1] > missed[2] or missed[0] < 5e-3
