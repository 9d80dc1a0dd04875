# SPDX-License-Identifier: Apache-2.0
"""The breaker solved as one by other means: judge of the coupled run, sharing no code with the machine.

Kinematics by complex numbers and implicit differentiation, equations of motion by virtual work of every link's mass
and moment of inertia (no derivatives of generalised masses), the motor's torque at the speed of the instant (Kloss),
scipy's DOP853 with a relative tolerance of 1e-12, events by Brent's method on its dense output of order 7.  Coulomb
friction of joints at rest by relaxation: each bearing in turn gives what stops its joint, as far as it can.
No samples, no coupling step.

Valid where the wall lets the tool go: the striker does not catch up with the tool it has struck.
"""

from __future__ import annotations

import cmath
import itertools
import math
from collections.abc import Callable
from functools import cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.optimize import brentq

from mech_twin.machines.mb10_breaker.parameters import BreakerParameters

Array = NDArray[np.float64]
TOLERANCE = 1e-12
LONGEST_S = 1e-3
PLASTIC_BELOW = 1e-7  # rad/s: a bounce slower than this ends its series
LET_GO = 1.0 + 1e-9  # of what friction can hold
RELAXATIONS = 2000


class ReferenceLink(NamedTuple):
    """Centroid r (m, complex, axes of the body) and angle of a link, with two derivatives in the crank angle each."""

    mass_kg: float
    inertia_kg_m2: float
    r: complex
    r1: complex
    r2: complex
    turn1: float
    turn2: float


class ReferenceState(NamedTuple):
    """What is integrated: crank (against the body, unwrapped) and body."""

    crank_rad: float
    crank_rad_per_s: float
    body_rad: float
    body_rad_per_s: float

    def speeds(self) -> Array:
        """Return the speeds of crank and body (rad/s)."""
        return np.array([self.crank_rad_per_s, self.body_rad_per_s])


class ReferenceMotion(NamedTuple):
    """Samples (n, 4) of q (unwrapped), u, phi, p at the asked times, and blows (m, 2): time (s), impulse (N s)."""

    samples: Array
    blows: Array


def _shares(whole: complex, a: complex, b: complex) -> tuple[float, float]:
    """Return x and y of whole = x a + y b."""
    across = (a.conjugate() * b).imag
    return (whole.conjugate() * b).imag / across, (a.conjugate() * whole).imag / across


class BreakerReference:
    """The machine of these parameters, crank and body free, supply at rated frequency from the start."""

    def __init__(self, parameters: BreakerParameters) -> None:
        self._p = p = parameters
        link = p.linkage
        self._on_frame = p.drive_mount == "frame"
        self._coulomb = (p.friction.coulomb_nm, p.body.friction.coulomb_nm)
        self._own = link.rocker_mass_kg * (link.rocker_centroid_along_m**2 + link.rocker_centroid_across_m**2)
        angles = np.linspace(0.0, 2.0 * math.pi, 721)
        rates = [self._rocker(q)[1] for q in angles]
        turns = [
            (brentq(lambda q: self._rocker(q)[1], a, b, xtol=1e-15), before)
            for a, b, before, after in zip(angles, angles[1:], rates, rates[1:], strict=False)
            if before * after < 0.0
        ]
        self._extreme = next(q for q, before in turns if before > 0.0)
        self._return = next(q for q, before in turns if before < 0.0)
        self._furthest = self._rocker(self._extreme)[0]

    def _rocker(self, q: float) -> tuple[float, float, float]:
        """Return the rocker's angle (rad) and its derivatives in the crank angle."""
        _, _, theta = self._loop(q)
        return theta

    def _loop(self, q: float) -> tuple[complex, tuple[float, float, float], tuple[float, float, float]]:
        """Return the crank pin, and angle with two derivatives of coupler and rocker.

        a e^{i q} + b e^{i beta} = d + c e^{i gamma}, the joint below the line of the bearings.
        """
        k = self._p.linkage
        pin, ground = k.crank_m * cmath.exp(1j * q), complex(k.ground_m)
        span = ground - pin
        cosine = (k.coupler_m**2 + abs(span) ** 2 - k.rocker_m**2) / (2.0 * k.coupler_m * abs(span))
        candidates = []
        for side in (1.0, -1.0):
            beta = cmath.phase(span) + side * math.acos(cosine)
            candidates.append((beta, pin + k.coupler_m * cmath.exp(1j * beta)))
        beta, joint = min(candidates, key=lambda c: c[1].imag)
        gamma = cmath.phase(joint - ground)
        b, c = k.coupler_m * cmath.exp(1j * beta), k.rocker_m * cmath.exp(1j * gamma)
        b1, c1 = _shares(-1j * pin, 1j * b, -1j * c)
        b2, c2 = _shares(pin + b * b1**2 - c * c1**2, 1j * b, -1j * c)
        return pin, (beta, b1, b2), (gamma, c1, c2)

    def links(self, q: float) -> tuple[ReferenceLink, ReferenceLink, ReferenceLink]:
        """Return crank, coupler and rocker at a crank angle."""
        k = self._p.linkage
        pin, (beta, b1, b2), (gamma, c1, c2) = self._loop(q)
        s1 = complex(k.crank_centroid_along_m, k.crank_centroid_across_m) * cmath.exp(1j * q)
        s2 = complex(k.coupler_centroid_along_m, k.coupler_centroid_across_m) * cmath.exp(1j * beta)
        s3 = complex(k.rocker_centroid_along_m, k.rocker_centroid_across_m) * cmath.exp(1j * gamma)
        own = k.crank_mass_kg * abs(s1) ** 2
        return (
            ReferenceLink(k.crank_mass_kg, k.crank_inertia_kg_m2 - own, s1, 1j * s1, -s1, 1.0, 0.0),
            ReferenceLink(
                k.coupler_mass_kg, k.coupler_inertia_kg_m2, pin + s2, 1j * pin + 1j * b1 * s2,
                -pin + (1j * b2 - b1**2) * s2, b1, b2,
            ),
            ReferenceLink(
                k.rocker_mass_kg, k.rocker_inertia_kg_m2 - self._own, k.ground_m + s3, 1j * c1 * s3,
                (1j * c2 - c1**2) * s3, c1, c2,
            ),
        )  # fmt: skip

    def mass_and_bias(self, q: float, u: float, phi: float, p: float) -> tuple[Array, Array]:
        """Return the mass matrix, and what inertia and weights ask of both coordinates at no acceleration (N m)."""
        m_qq, m_qp, m_pp, of_crank, of_body = self._inertia(q, u, phi, p)
        return np.array([[m_qq, m_qp], [m_qp, m_pp]]), np.array([of_crank, of_body])

    def _inertia(self, q: float, u: float, phi: float, p: float) -> tuple[float, float, float, float, float]:
        """Return the three different numbers of the mass matrix, and both of the bias."""
        ratio, rotor = self._p.gear.ratio, self._p.motor.rotor_inertia_kg_m2
        by_body = -ratio if self._on_frame else 1.0
        m_qq, m_qp = rotor * ratio * ratio, rotor * ratio * by_body
        m_pp = rotor * by_body * by_body + self._p.body.inertia_kg_m2
        of_crank = of_body = 0.0
        down = -1j * self._p.gravity_m_per_s2 * cmath.exp(1j * phi)
        for k in self.links(q):
            by_q, by_p = k.r1.conjugate(), (-1j * k.r).conjugate()
            force = k.mass_kg * (k.r2 * u * u - 2j * k.r1 * u * p - k.r * p * p - down)
            moment = k.inertia_kg_m2 * k.turn2 * u * u
            m_qq += k.mass_kg * (by_q * k.r1).real + k.inertia_kg_m2 * k.turn1 * k.turn1
            m_qp += k.mass_kg * (by_q * -1j * k.r).real - k.inertia_kg_m2 * k.turn1
            m_pp += k.mass_kg * (by_p * -1j * k.r).real + k.inertia_kg_m2
            of_crank += (by_q * force).real + moment * k.turn1
            of_body += (by_p * force).real - moment
        return m_qq, m_qp, m_pp, of_crank, of_body

    def motor_torque(self, rotor: float) -> float:
        """Return Kloss' torque at a rotor speed (rad/s), supply at rated frequency."""
        m = self._p.motor
        synchronous, rated = m.synchronous_speed_rpm * math.pi / 30.0, m.rated_speed_rpm * math.pi / 30.0
        slip = (synchronous - rated) / synchronous
        largest = m.breakdown_torque_ratio
        critical = slip * (largest + math.sqrt(largest**2 - 1.0))
        now = (synchronous - rotor) / synchronous
        return 2.0 * largest * m.rated_power_w / rated / (now / critical + critical / now) if now else 0.0

    def forces(self, q: float, u: float, phi: float, p: float) -> tuple[float, float]:
        """Return what drive, spring and viscous friction do on both coordinates (N m)."""
        b, gear = self._p.body, self._p.gear
        torque = self.motor_torque(gear.ratio * (u - p if self._on_frame else u))
        forward = torque * (u - self._on_frame * p) >= 0.0
        drive = torque * gear.ratio * (gear.efficiency if forward else 1.0 / gear.efficiency)
        bearing, pivot = self._p.friction.viscous_nms_per_rad * u, b.friction.viscous_nms_per_rad
        damping = pivot + 2.0 * b.damping_ratio * b.spring_arm_m * math.sqrt(b.spring_rate_n_per_m * b.inertia_kg_m2)
        spring = b.spring_rate_n_per_m * (b.spring_arm_m * phi + b.preload_deflection_m) * b.spring_arm_m
        return drive - bearing, -self._on_frame * drive - spring - damping * p

    def accelerations(
        self, state: ReferenceState, rests: bool, senses: Array | None = None
    ) -> tuple[float, float, float]:
        """Return u', p' and the moment of the collar; of a joint at rest that a sense of 0 holds, 0."""
        du, dp, held = self.motion(state, rests, np.sign(state.speeds()) if senses is None else senses)
        return du, dp, held[1]

    def motion(self, state: ReferenceState, rests: bool, senses: Array) -> tuple[float, float, tuple[float, float]]:
        """Return u', p', and what holds crank and body where they are at rest (N m); senses of sliding, 0: held."""
        m_qq, m_qp, m_pp, of_crank, of_body = self._inertia(*state)
        on_crank, on_body = self.forces(*state)
        on_crank -= of_crank + self._coulomb[0] * senses[0]
        on_body -= of_body + (0.0 if rests else self._coulomb[1] * senses[1])
        crank_held = senses[0] == 0.0 and self._coulomb[0] > 0.0
        body_held = rests or (senses[1] == 0.0 and self._coulomb[1] > 0.0)
        if crank_held and body_held:
            return 0.0, 0.0, (-on_crank, -on_body)
        if body_held:
            du = on_crank / m_qq
            return du, 0.0, (0.0, m_qp * du - on_body)
        if crank_held:
            dp = on_body / m_pp
            return 0.0, dp, (m_qp * dp - on_crank, 0.0)
        both = m_qq * m_pp - m_qp * m_qp
        return (on_crank * m_pp - on_body * m_qp) / both, (on_body * m_qq - on_crank * m_qp) / both, (0.0, 0.0)

    def senses(self, state: ReferenceState, rests: bool) -> Array:
        """Return the senses in which both joints go on; 0 where friction holds a joint at rest."""
        most = np.array(self._coulomb)
        at_rest = ((state.speeds() == 0.0) | np.array([False, rests])) & (most > 0.0)
        if not at_rest.any():
            return np.sign(state.speeds())
        mass, bias = self.mass_and_bias(*state)
        moving = np.where(at_rest, 0.0, np.sign(state.speeds()))
        right = np.array(self.forces(*state)) - bias - most * moving
        answer, friction, found = np.linalg.inv(mass), np.zeros(2), np.zeros(2)
        if rests:
            answer = np.array([[1.0 / mass[0, 0], 0.0], [0.0, 0.0]])
        for _ in range(RELAXATIONS):
            for i in np.flatnonzero(at_rest & np.array([True, not rests])):
                found = answer @ (right + friction)
                friction[i] = np.clip(friction[i] - found[i] / answer[i, i], -most[i], most[i])
        found = answer @ (right + friction)
        return np.where(at_rest, np.where(np.abs(found) > 1e-9, np.sign(found), 0.0), moving)

    def gap(self, q: float, phi: float) -> float:
        """Return the gap between striker and seated tool (m)."""
        travel = self._p.tool.overtravel_m + self._p.linkage.striker_arm_m * math.remainder(
            self._rocker(q)[0] - self._furthest, 2.0 * math.pi
        )
        return self._p.body.tool_radius_m * phi - travel

    def blow(self, state: ReferenceState) -> tuple[ReferenceState, float]:
        """Return the state after a blow on the seated tool, and the impulse (N s); a resting body is free to leave."""
        mass, _ = self.mass_and_bias(*state)
        lever = self._p.linkage.striker_arm_m * self._rocker(state.crank_rad)[1]
        direction = np.array([lever, -self._p.body.tool_radius_m])
        answer = np.linalg.solve(mass, direction)
        if state.body_rad == 0.0 and state.body_rad_per_s == 0.0 and answer[1] > 0.0:
            answer = np.array([direction[0] / mass[0, 0], 0.0])
        seen = 1.0 / (direction @ answer)
        m_t = self._p.tool.mass_kg
        impulse = (1.0 + self._p.tool.restitution) * (direction @ state.speeds()) * seen * m_t / (seen + m_t)
        u, p = state.speeds() - answer * impulse
        return state._replace(crank_rad_per_s=u, body_rad_per_s=p), float(impulse)

    def run(self, times_s: Array, start: Array | None = None) -> ReferenceMotion:
        """Return the motion at ascending times (s, the first 0), from standstill with the body on its collar.

        ``start``: another crank angle, crank speed, body angle and rate; a body at angle 0 rests.
        """
        state = ReferenceState(math.radians(self._p.linkage.initial_crank_deg) % (2.0 * math.pi), 0.0, 0.0, 0.0)
        state = state if start is None else ReferenceState(*start)
        samples, blows = np.empty((len(times_s), 4)), []
        samples[0], index, time = state, 1, 0.0
        rests, waiting, zero_at = state.body_rad == 0.0, True, -1.0
        while index < len(times_s):
            senses = self.senses(state, rests)
            here = self._stepper(time, state, rests, senses, float(times_s[-1]))
            while True:
                here.step()
                dense, low, high = here.dense_output(), float(here.t_old), float(here.t)
                which, when = self._first(dense, low, high, rests, senses, waiting, zero_at)
                while index < len(times_s) and times_s[index] <= when:
                    samples[index] = dense(times_s[index])
                    index += 1
                before = ReferenceState(*dense(low))
                if not waiting and self._passed(before.crank_rad, ReferenceState(*dense(when)).crank_rad, self._return):
                    waiting = True
                if which is not None or here.status != "running":
                    break
            state, time, zero_at = ReferenceState(*dense(when)), when, -1.0
            if which == "blow":
                state, impulse = self.blow(state)
                blows.append((when, impulse))
                rests, waiting = rests and state.body_rad_per_s <= 0.0, False
            elif which == "missed":
                waiting = False
            elif which == "touchdown":
                state, rests = self._touchdown(state)
            elif which == "lift":
                rests = False
            elif which == "crank stops":
                state = state._replace(crank_rad_per_s=0.0)
            elif which == "body stops":
                state = state._replace(body_rad_per_s=0.0)
            zero_at = when if which not in (None, "missed") else -1.0
        return ReferenceMotion(samples, np.array(blows).reshape(-1, 2))

    def _stepper(self, time: float, state: ReferenceState, rests: bool, senses: Array, end: float) -> Any:
        def rates(_: float, y: Array) -> list[float]:
            now = ReferenceState(*y)
            du, dp, _held = self.motion(now, rests, senses)
            return [now.crank_rad_per_s, du, now.body_rad_per_s, dp]

        start, first = state, 1e-6
        if rests:
            start = state._replace(body_rad=0.0, body_rad_per_s=0.0)
        else:  # neither a bounce nor a fall must end within the first step
            sink = max(-self.motion(state, False, senses)[1], 1e-9)
            phi, p = state.body_rad, state.body_rad_per_s
            lasts = p / sink if phi == 0.0 else math.sqrt(p**2 / sink**2 + 2.0 * phi / sink)
            first = min(first, max(0.1 * lasts, 1e-13))
        return DOP853(
            rates, time, np.array(start), end, max_step=LONGEST_S, rtol=TOLERANCE, atol=1e-13, first_step=first
        )

    def _passed(self, before: float, after: float, angle: float) -> bool:
        return math.floor((after - angle) / (2.0 * math.pi)) > math.floor((before - angle) / (2.0 * math.pi))

    def _first(
        self,
        dense: Callable[[float], Array],
        low: float,
        high: float,
        rests: bool,
        senses: Array,
        waiting: bool,
        zero_at: float,
    ) -> tuple[str | None, float]:
        """Return the first event of a step and its time; ``zero_at``: of an event whose signal may still be zero."""
        found: list[tuple[float, str]] = []

        def look(name: str, value: Callable[[float], float]) -> None:
            places = [t for t in np.linspace(low, high, 5) if t > zero_at + 1e-12]
            values = [value(t) for t in places]
            for (a, before), (b, after) in itertools.pairwise(zip(places, values, strict=True)):
                if before > 0.0 >= after:
                    found.append((float(brentq(value, a, b, xtol=1e-15, rtol=1e-15)), name))
                    return
            if places and zero_at >= low and values[0] <= 0.0 and not name.endswith("stops"):
                found.append((float(places[0]), name))

        @cache
        def at(t: float) -> ReferenceState:
            return ReferenceState(*map(float, dense(t)))

        def held(t: float, joint: int) -> float:
            return self.motion(at(t), rests, senses)[2][joint]

        if waiting:
            look("blow", lambda t: self.gap(at(t).crank_rad, at(t).body_rad))
            if self._passed(at(low).crank_rad, at(high).crank_rad, self._extreme):
                turns = math.floor((at(high).crank_rad - self._extreme) / (2.0 * math.pi))
                aim = self._extreme + 2.0 * math.pi * turns
                look("missed", lambda t: aim - at(t).crank_rad)
        if rests:
            look("lift", lambda t: held(t, 1) + LET_GO * self._coulomb[1])
        else:
            look("touchdown", lambda t: at(t).body_rad)
        for joint, name in ((0, "crank"), (1, "body")):
            most = self._coulomb[joint]
            if most > 0.0 and senses[joint] == 0.0 and not (rests and joint == 1):
                look(f"{name} starts", partial(lambda j, c, t: LET_GO * c - abs(held(t, j)), joint, most))
            elif most > 0.0 and senses[joint] != 0.0:
                look(f"{name} stops", partial(lambda j, t: float(senses[j] * at(t).speeds()[j]), joint))
        if not found:
            return None, high
        when, which = min(found)
        return which, when

    def _touchdown(self, state: ReferenceState) -> tuple[ReferenceState, bool]:
        q, u, _, p = state
        mass, _ = self.mass_and_bias(q, u, 0.0, p)
        slow = -p * self._p.body.restitution < PLASTIC_BELOW
        jump = -(1.0 + (0.0 if slow else self._p.body.restitution)) * p
        return ReferenceState(q, u - mass[0, 1] / mass[0, 0] * jump, 0.0, p + jump), slow
