# SPDX-License-Identifier: Apache-2.0
"""A blow through a contact stiffness, against crank, body and tool integrated together by a code of its own.

The reference knows the four-bar from its loop closure, the masses from the kinetic energy, and the contact as a spring
and dashpot between striking face and tool; nothing of `parts` or of the machine's dynamics is in it.
"""

import cmath
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from mech_twin.machines.mb10_breaker.dynamics import striker
from mech_twin.machines.mb10_breaker.impacts import blow, blow_contact, fading
from mech_twin.machines.mb10_breaker.metrics import striking_angle
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parameters.load import machine_parameters

KEPT = "contact_blow_energy_change_restitution_kept"
PARAMETERS = machine_parameters("mb10_breaker")
SPEED = 66.52


class Mechanism:
    """Crank, coupler, rocker and body from lengths and masses: positions as complex numbers, the body's frame."""

    def __init__(self, p):
        self.p, self.link = p, p.linkage
        rotor = p.gear.ratio**2 * p.motor.rotor_inertia_kg_m2
        self.crank = self.link.crank_inertia_kg_m2
        self.rotor = rotor  # turns with i (u - p)
        self.extreme = self._extreme()

    def angles(self, q):
        """Coupler and rocker angle of the branch with the rocker pin below the line A'D."""
        link = self.link
        pin = link.crank_m * cmath.exp(1j * q)
        to_d = link.ground_m - pin
        distance = abs(to_d)
        cosine = (link.coupler_m**2 + distance**2 - link.rocker_m**2) / (2.0 * link.coupler_m * distance)
        coupler = cmath.phase(to_d) + self.side * math.acos(cosine)
        rocker_pin = pin + link.coupler_m * cmath.exp(1j * coupler)
        return coupler, cmath.phase(rocker_pin - link.ground_m)

    side = -1.0

    def _extreme(self):
        """Crank angle at which crank and coupler lie in line and the rocker is farthest counter-clockwise."""
        turns = np.linspace(0.0, 2.0 * math.pi, 20001)
        rocker = np.unwrap([self.angles(q)[1] for q in turns])
        return turns[int(np.argmax(rocker))]

    def rocker_rise(self, q):
        return math.remainder(self.angles(q)[1] - self.angles(self.extreme)[1], 2.0 * math.pi)

    def travel(self, q):
        return self.p.tool.overtravel_m + self.link.striker_arm_m * self.rocker_rise(q)

    def slopes(self, q):
        """Rates of coupler and rocker angle per crank angle, from the closure of the loop."""
        link, (coupler, rocker) = self.link, self.angles(q)
        crank = link.crank_m * cmath.exp(1j * q)
        arm, swing = link.coupler_m * cmath.exp(1j * coupler), link.rocker_m * cmath.exp(1j * rocker)
        matrix = [[arm.real, -swing.real], [arm.imag, -swing.imag]]
        return np.linalg.solve(matrix, [-crank.real, -crank.imag])

    def masses(self, q):
        """Mass matrix in (u, p) as the Hessian of the kinetic energy; p turns everything clockwise."""
        link, (coupler, rocker) = self.link, self.angles(q)
        g2, g3 = self.slopes(q)
        pin = link.crank_m * cmath.exp(1j * q)
        along = complex(link.coupler_centroid_along_m, link.coupler_centroid_across_m)
        swing = complex(link.rocker_centroid_along_m, link.rocker_centroid_across_m)
        own = link.rocker_inertia_kg_m2 - link.rocker_mass_kg * abs(swing) ** 2
        two = pin + along * cmath.exp(1j * coupler)
        three = link.ground_m + swing * cmath.exp(1j * rocker)
        moves = (  # mass, velocity per u and per p; inertia, rate per u and per p
            (link.coupler_mass_kg, 1j * pin + 1j * g2 * (two - pin), -1j * two),
            (link.rocker_mass_kg, 1j * g3 * (three - link.ground_m), -1j * three),
        )
        turns = (
            (self.crank + self.rotor, 1.0),
            (link.coupler_inertia_kg_m2, g2),
            (own, g3),
        )
        m = np.zeros((2, 2))
        for mass, of_u, of_p in moves:
            m += mass * np.array(
                [[abs(of_u) ** 2, (of_u * of_p.conjugate()).real], [(of_u * of_p.conjugate()).real, abs(of_p) ** 2]]
            )
        for inertia, rate in turns:
            m += inertia * np.array([[rate * rate, -rate], [-rate, 1.0]])
        m[1, 1] += self.p.body.inertia_kg_m2
        return m

    def accelerations(self, q, u, phi, p, force):
        """Lagrange's equations without drive: M a = j F - M' terms - spring."""
        step, speeds = 1e-5, np.array([u, p])
        m = self.masses(q)
        m_q = (self.masses(q + step) - self.masses(q - step)) / (2.0 * step)
        body = self.p.body
        spring = body.spring_rate_n_per_m * (body.spring_arm_m * phi + body.preload_deflection_m) * body.spring_arm_m
        slope = self.link.striker_arm_m * self.slopes(q)[1]
        right = -u * (m_q @ speeds) + np.array([0.5 * speeds @ m_q @ speeds, 0.0])
        right += np.array([-slope * force, body.tool_radius_m * force - spring])
        return np.linalg.solve(m, right)


def integrated(p, q, u, stiffness, damping):
    """Peak force, contact time and the tool's energy of one blow on a body at rest."""
    mechanism = Mechanism(p)
    mass, radius = p.tool.mass_kg, p.body.tool_radius_m

    def contact(state):
        slope = p.linkage.striker_arm_m * mechanism.slopes(state[0])[1]
        depth = mechanism.travel(state[0]) - radius * state[2] - state[4]
        return stiffness * depth + damping * (slope * state[1] - radius * state[3] - state[5])

    def slope(_, state):
        force = contact(state)
        du, dp = mechanism.accelerations(*state[:4], force)
        return [state[1], du, state[3], dp, state[5], force / mass]

    def ended(time, state):
        return contact(state) if time > 1e-5 else 1.0

    ended.terminal, ended.direction = True, -1.0
    done = solve_ivp(slope, (0.0, 0.01), [q, u, 0.0, 0.0, 0.0, 0.0], rtol=1e-8, atol=1e-11, events=ended, max_step=1e-5)
    return max(contact(state) for state in done.y.T), done.t[-1], 0.5 * mass * done.y[5, -1] ** 2


@pytest.mark.parametrize(
    ("stiffness", "printed"),
    [  # peak force (kN), time (ms), changes (%): the table of the machine's page
        (2e8, (53.5, 0.53, -4.7, -15.0)),
        (5e7, (26.0, 0.99, -19.0, -28.0)),
    ],
)
def test_the_page_tells_what_the_estimate_is_at_the_steady_speed(stiffness, printed):
    b = breaker(PARAMETERS)
    q = striking_angle(b)
    hit = blow(b, q, SPEED, 0.0, 0.0, True)
    fades = fading(b, q, SPEED, 0.0, 0.0, 0.0, False)
    found = blow_contact(b, stiffness, striker(b, q)[1] * SPEED, hit.impulse, fades)
    scaled = [1e-3 * found["contact_peak_force_n"], 1e3 * found["contact_time_s"]]
    scaled += [100.0 * found[name] for name in ("contact_blow_energy_change", KEPT)]
    assert fades == pytest.approx(384.0, abs=0.5)
    for value, told, half in zip(scaled, printed, (0.051, 0.0051, 0.5, 0.5), strict=True):
        assert value == pytest.approx(told, abs=half)


@pytest.mark.parametrize(
    ("stiffness", "printed_force_n", "printed_time_s", "printed_change"),
    [(2e8, 53e3, 0.5e-3, -0.045), (5e7, 26e3, 1.0e-3, -0.19)],
)
def test_the_estimate_is_the_coupled_motion(stiffness, printed_force_n, printed_time_s, printed_change):
    b, e = breaker(PARAMETERS), PARAMETERS.tool.restitution
    q = striking_angle(b)
    hit = blow(b, q, SPEED, 0.0, 0.0, True)
    mechanism = Mechanism(PARAMETERS)
    own_q = brentq(mechanism.travel, mechanism.extreme - 0.5, mechanism.extreme - 0.05, xtol=1e-14) % (2.0 * math.pi)
    assert own_q == pytest.approx(q, abs=1e-6)  # the extreme of the reference is read off a fine grid
    closing = PARAMETERS.linkage.striker_arm_m * mechanism.slopes(q)[1] * SPEED
    found = blow_contact(b, stiffness, closing, hit.impulse, fading(b, q, SPEED, 0.0, 0.0, 0.0, False))
    decay = -math.log(e)
    zeta = decay / math.hypot(math.pi, decay)
    mass = hit.impulse / ((1.0 + e) * closing)
    force, time, energy = integrated(PARAMETERS, own_q, SPEED, stiffness, 2.0 * zeta * math.sqrt(stiffness * mass))
    change = energy / hit.tool_energy - 1.0
    assert found["contact_peak_force_n"] == pytest.approx(force, rel=5e-3)
    assert found["contact_time_s"] == pytest.approx(time, rel=1e-2)
    assert found["contact_blow_energy_change"] == pytest.approx(change, abs=0.015)
    assert force == pytest.approx(printed_force_n, abs=0.5e3)
    assert time == pytest.approx(printed_time_s, abs=0.5e-4)
    assert change == pytest.approx(printed_change, abs=0.005)


def test_the_damping_that_keeps_the_restitution_loses_more():
    b = breaker(PARAMETERS)
    q = striking_angle(b)
    hit = blow(b, q, SPEED, 0.0, 0.0, True)
    found = blow_contact(b, 2e8, 1.58, hit.impulse, 400.0)
    assert found[KEPT] < found["contact_blow_energy_change"] < 0.0


def test_a_stiff_contact_loses_nothing():
    b = breaker(PARAMETERS)
    q = striking_angle(b)
    hit = blow(b, q, SPEED, 0.0, 0.0, True)
    assert blow_contact(b, 1e12, 1.58, hit.impulse, 400.0)[KEPT] == pytest.approx(0.0, abs=3e-3)
