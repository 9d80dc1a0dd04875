# SPDX-License-Identifier: Apache-2.0
"""Random legal presses and vibration cranks, corners included: finite, balanced, or refused in one line."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.parameters.load import machine


class Draw:
    """Random numbers of the kinds a configuration needs."""

    def __init__(self, seed):
        self.random = np.random.default_rng(seed)

    def one_of(self, *values):
        return values[self.random.integers(len(values))]

    def spread(self, low, high):
        return float(10.0 ** self.random.uniform(math.log10(low), math.log10(high)))

    def between(self, low, high):
        return float(self.random.uniform(low, high))

    def drive(self):
        out = {
            "drive.speed_rpm": self.one_of(1.0, -1.0) * self.spread(5.0, 1500.0),
            "supply.initial_fraction": self.one_of(0.0, 0.5, 1.0),
            "supply.rate_per_s": self.one_of(0.1, 2.0, 100.0),
            "coupling.step_s": self.one_of(1e-3, 5e-3, 0.02),
            "friction.coulomb_nm": self.one_of(0.0, self.spread(0.01, 1e3)),
            "friction.viscous_nms_per_rad": self.one_of(0.0, self.spread(1e-3, 10.0)),
        }
        if self.one_of(True, False):
            synchronous = self.one_of(750.0, 1500.0, 3000.0)
            out |= {
                "drive.kind": "kloss",
                "motor.rated_power_w": self.spread(100.0, 1e5),
                "motor.rated_speed_rpm": synchronous * self.between(0.9, 0.99),
                "motor.synchronous_speed_rpm": synchronous,
                "motor.breakdown_torque_ratio": self.between(1.6, 3.0),
                "motor.starting_torque_ratio": self.between(0.8, 1.6),
                "motor.rotor_inertia_kg_m2": self.spread(1e-4, 1.0),
                "motor.torque_curve": self.one_of("kloss", "starting_corrected"),
                "gear.ratio": self.spread(1.0, 50.0),
                "gear.efficiency": self.one_of(1.0, 0.95, 0.1),
            }
        return out

    def press(self):
        r = self.spread(0.005, 0.5)
        r1, r3, ground = 0.0, 0.0, 1e9
        while r + ground > r1 + r3 or abs(ground - r) < abs(r1 - r3):
            r1, r3, ground = (r * self.between(a, 12.0) for a in (1.0, 1.0, 0.0))
        turn = self.between(0.0, 2.0 * math.pi)
        out = {
            "linkage.crank_m": r,
            "linkage.coupler_m": r1,
            "linkage.pendulum_m": r3,
            "linkage.pivot_x_m": ground * math.cos(turn),
            "linkage.pivot_y_m": ground * math.sin(turn),
            "linkage.branch": self.one_of("open", "crossed"),
            "working_force.peak_n": self.one_of(0.0, self.spread(10.0, 1e5)),
            "working_force.application_from_a_m": r1 * self.between(-0.2, 1.2),
            "working_force.application_across_m": r1 * self.one_of(0.0, self.between(-0.2, 0.2)),
            "working_force.contact_fraction": self.one_of(0.0, 1e-9, 0.999, self.between(0.0, 1.0)),
            "working_force.exponent": self.one_of(0.0, 0.1, 0.5, 1.0, 3.0, 20.0),
            "flywheel.inertia_kg_m2": self.one_of(0.0, self.spread(0.01, 100.0)),
        }
        for link, length in (("crank", r), ("plate", r1), ("pendulum", r3)):
            out |= {
                f"links.{link}.mass_kg": self.one_of(0.0, self.spread(0.1, 100.0)),
                f"links.{link}.inertia_kg_m2": self.spread(1e-4, 10.0) if link == "crank" else self.one_of(0.0, 0.5),
                f"links.{link}.centroid_along_m": length * self.between(-0.5, 1.5),
                f"links.{link}.centroid_across_m": length * self.one_of(0.0, self.between(-0.2, 0.2)),
            }
        return out

    def crank(self):
        r = self.spread(0.01, 0.5)
        out = {
            f"masses.{part}_kg": self.one_of(0.0, self.spread(0.1, 200.0)) for part in ("tree", "boom", "rod", "pin")
        }
        out |= {
            "masses.stand_kg": self.spread(0.1, 100.0),
            "masses.rotating_kg": self.one_of(None, 0.0, 5.0),
            "crank_m": r,
            "counterweight.radius_m": self.spread(0.01, 1.0),
            "counterweight.mass_kg": self.one_of(None, 0.0, 50.0),
            "working_force_n": self.one_of(0.0, -1000.0, 1e4),
            "slider": self.one_of("above", "below"),
            "rod_m": self.one_of(math.inf, r * self.between(1.0, 10.0)),
            "offset_m": self.one_of(0.0, r * self.between(-1.0, 1.0)),
        }
        if self.one_of(True, False):
            boom, rod, ground = (r * self.between(a, 12.0) for a in (0.5, 0.5, 0.0))
            turn = self.between(0.0, 2.0 * math.pi)
            out |= {
                "rod_m": rod,
                "boom.pivot_x_m": ground * math.cos(turn),
                "boom.pivot_y_m": ground * math.sin(turn),
                "boom.length_m": boom,
                "boom.load_ratio": self.spread(0.1, 5.0),
                "boom.side": self.one_of("left", "right"),
            }
        return out


def checked_run(name, overrides, seconds):
    """Return whether the configuration was legal; fail where a number is not finite or a residual is over its limit."""
    try:
        twin = machine(name, overrides=overrides)
    except ConfigurationError as refused:
        assert "\n" not in str(refused)
        return False
    assert all(math.isfinite(value) for value in twin.report().values()), overrides
    observer = twin.observer()
    for frame in frames(twin, seconds):
        observer.observe(frame)
        for role, sample in ((twin.linkage, frame.linkage), (twin.forces, frame.forces)):
            for residual, value in sample.residuals.as_dict().items():
                assert abs(value) <= role.residual_limits[residual], (residual, value, overrides)
        numbers = (*frame.linkage.velocity, *frame.linkage.effort, *frame.linkage.memory.values)
        assert all(map(math.isfinite, (*numbers, *frame.forces.quantities.values))), overrides
    assert all(map(math.isfinite, observer.numbers().values())), overrides
    return True


@pytest.mark.slow
@pytest.mark.parametrize("name", ["compaction_press", "vibration_crank"])
def test_random_legal_machines_are_finite_and_keep_their_residuals(name):
    legal = 0
    for seed in range(40):
        draw = Draw(seed)
        overrides = (draw.press if name == "compaction_press" else draw.crank)() | draw.drive()
        legal += checked_run(name, overrides, 0.3)
    assert legal >= 15
