# SPDX-License-Identifier: Apache-2.0
"""The energy of the half sine's body, by quadrature: closed for the true motion, open for one that is not."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker.pressed_body import collar_contact
from mech_twin.machines.mb10_breaker.pressed_body.collar_contact import energy_left_open, work_per_inertia
from mech_twin.machines.mb10_breaker.pressed_body.flight import SwingStretch, motion
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.parameters.load import machine, machine_parameters

HELD = {"excitation.kind": "approximated", "body.inertia_kg_m2": 0.35, "body.spring_rate_n_per_m": 3108.0}
HALF = {**HELD, "body.preload_deflection_m": 0.0483}  # the preload is half of the load
FREE = 1


def drawn(seed):
    """Return a body of random spring and damping, a stretch of it under load or without, and its ends (s)."""
    rng = np.random.default_rng(seed)
    overrides = {
        **HELD,
        "body.spring_rate_n_per_m": float(10.0 ** rng.uniform(2.0, 6.5)),
        "body.preload_deflection_m": float(rng.choice([0.0, 0.03])),
        "body.damping_ratio": float(rng.choice([0.0, 0.2, 0.9])),
    }
    p = machine_parameters("mb10_breaker", overrides=overrides)
    body = pressed_body(p.body, p.excitation)
    load = float(rng.choice([0.0, body.amplitude]))
    stretch = SwingStretch(float(rng.uniform(0.0, 0.02)), float(rng.uniform(-1.0, 1.0)), load, float(rng.uniform(0, 3)))
    start = float(rng.uniform(0.0, 0.01))
    return body, stretch, start, start + float(rng.choice([1e-6, 1e-3, 5e-3]))


@pytest.mark.parametrize("seed", range(60))
def test_energy_closes_in_any_stretch(seed):
    assert abs(energy_left_open(*drawn(seed))) <= 1e-11


def test_work_is_that_of_an_adaptive_quadrature():
    body, stretch, start, end = drawn(5)

    def power(s):
        angle, rate = motion(body, stretch, s)
        load = stretch.load / body.inertia * math.sin(stretch.theta + body.mu * s)
        return (load - body.k**2 * (angle + body.rest_angle) - 2.0 * body.damping * body.k * rate) * rate

    found, _ = quad(power, start, end, epsabs=1e-14, epsrel=1e-12)
    assert work_per_inertia(body, stretch, start, end) == pytest.approx(found, rel=1e-11)


@pytest.mark.parametrize("wrong", ["frequency", "rate", "load"])
def test_energy_is_open_for_a_motion_that_is_not_the_body_s(monkeypatch, wrong):
    body, stretch = drawn(0)[0]._replace(damping=0.0), SwingStretch(0.01, 0.5, 30.0, 0.3)

    def false_motion(b, now, s):
        if wrong == "frequency":
            return motion(b._replace(k=1.01 * b.k, rest_angle=b.rest_angle / 1.01**2), now, s)
        if wrong == "load":
            return motion(b, now._replace(load=0.99 * now.load), s)
        angle, rate = motion(b, now, s)
        return angle, rate * (1.0 + 1e-3 * s)

    monkeypatch.setattr(collar_contact, "motion", false_motion)
    monkeypatch.setattr(collar_contact, "work_per_inertia", getattr(work_per_inertia, "py_func", work_per_inertia))
    python = getattr(energy_left_open, "py_func", energy_left_open)
    assert abs(python(body, stretch, 0.0, 5e-3)) > 1e-8


@pytest.mark.slow
def test_energy_of_a_run_closes_in_every_step():
    twin = machine("mb10_breaker", overrides=HALF)
    samples = [frame.body for frame in frames(twin, 1.0)]
    assert sum(sample.regime == FREE for sample in samples) > 100
    assert max(abs(sample.residuals["energy_balance"]) for sample in samples) <= 1e-12
