# SPDX-License-Identifier: Apache-2.0
"""A body of a user's own in place of the breaker's: it integrates what the force analysis tells, and is taken."""

from __future__ import annotations

from dataclasses import replace

from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine, machine_parameters
from mech_twin.samples import BodySample, Named

PARAMETERS = machine_parameters("mb10_breaker")
NONE = Named((), ())
REST, FLIGHT = 0, 1
STRIKES = ("blow", "catch_up", "push_begins")
SUBSTEP_S = 2e-5


class OwnBody:
    """J p' + c (l phi + a) l = M by steps of Heun's rule; between what it is told the moment is a line."""

    joints, regimes, residual_limits = ("body",), ("rest", "flight"), {}

    def __init__(self):
        self._moment_nm = 0.0

    def start(self, forces):
        self._moment_nm = forces.body_moment_nm
        return self._sample(forces, 0.0, 0.0, REST)

    def follow(self, body, forces):
        phi, p, regime, time_s = body.position[0], body.velocity[0], body.regime, body.time_s
        for load in forces.loads:
            phi, p = self._flown(phi, p, regime, load.moment_before_nm, load.time_s - time_s)
            time_s, self._moment_nm = load.time_s, load.moment_after_nm
            if load.kind in STRIKES:
                p += load.impulse_nms / PARAMETERS.body.inertia_kg_m2
                regime = FLIGHT if p > 0.0 else regime
            elif load.kind == "touchdown":
                phi, p = 0.0, -PARAMETERS.body.restitution * p
            elif load.kind in ("settled", "lift_off"):
                phi, p, regime = 0.0, 0.0, REST if load.kind == "settled" else FLIGHT
        phi, p = self._flown(phi, p, regime, forces.body_moment_nm, forces.time_s - time_s)
        self._moment_nm = forces.body_moment_nm
        return self._sample(forces, phi, p, regime)

    def _flown(self, phi, p, regime, final_nm, span_s):
        if regime == REST or span_s <= 0.0:
            return phi, p
        count = int(span_s / SUBSTEP_S) + 1
        h, b = span_s / count, PARAMETERS.body

        def pushed(k, angle):
            moment = self._moment_nm + (final_nm - self._moment_nm) * k / count
            spring = b.spring_rate_n_per_m * (b.spring_arm_m * angle + b.preload_deflection_m) * b.spring_arm_m
            return (moment - spring) / b.inertia_kg_m2

        for k in range(count):
            first = pushed(k, phi)
            second = pushed(k + 1, phi + h * p)
            phi, p = phi + h * (p + 0.5 * h * first), p + 0.5 * h * (first + second)
        return phi, p

    def _sample(self, forces, phi, p, regime):
        b = PARAMETERS.body
        force = b.spring_rate_n_per_m * (b.spring_arm_m * phi + b.preload_deflection_m)
        effort = (-force * b.spring_arm_m,)
        return BodySample(forces.step, forces.time_s, ("body",), (phi,), (p,), effort, regime, force, NONE, NONE)


def test_linkage_takes_the_angle_of_a_body_of_a_user_s_own():
    twin = machine("mb10_breaker")
    led = list(frames(twin, 1.0))
    taken = list(frames(replace(twin, body=OwnBody()), 1.0))
    assert [e.kind for f in taken for e in f.linkage.events] == [e.kind for f in led for e in f.linkage.events]
    apart = max(abs(a.body.position[0] - b.body.position[0]) for a, b in zip(taken, led, strict=True))
    assert 0.0 < apart <= 1e-5  # the line between steps, of an angle of up to 9 mrad
    residuals = [frame.linkage.residuals for frame in taken]
    assert 0.0 < max(r["coupling_defect"] for r in residuals) <= twin.linkage.residual_limits["coupling_defect"]
    assert max(r["energy_balance"] for r in residuals) <= 1e-9
    assert max(r["momentum_balance"] for r in residuals) <= 1e-9


def test_body_of_the_breaker_answers_what_the_linkage_led_it_to():
    twin = machine("mb10_breaker")
    for frame in frames(twin, 1.0):
        assert frame.body.position[0] == frame.linkage.joint("body").position
        assert frame.body.velocity[0] == frame.linkage.joint("body").velocity
        assert frame.linkage.residuals["coupling_defect"] == 0.0
        assert (frame.body.regime == REST) == (frame.linkage.regime == REST)


def test_body_that_is_held_still_keeps_the_linkage_s_from_rising():
    """A body that answers rest at each step is one that cannot move: what it takes is booked."""

    class Still(OwnBody):
        def follow(self, body, forces):
            return self._sample(forces, 0.0, 0.0, REST)

    taken = list(frames(replace(machine("mb10_breaker"), body=Still()), 0.6))
    assert max(frame.linkage.joint("body").position for frame in taken) <= 1e-3
    assert abs(taken[-1].linkage.memory["coupling_defect_j"]) > 1e-3
    assert max(frame.linkage.residuals["energy_balance"] for frame in taken) <= 1e-9
