# SPDX-License-Identifier: Apache-2.0
"""Design problem of the press: what is evaluated is the configuration's machine, checked by kinematics of its own."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

from mech_twin.errors import StudyError
from mech_twin.machines.compaction_press.design_evaluation import (
    configured_press,
    described,
    design_problem,
    evaluation,
)
from mech_twin.machines.compaction_press.design_problem import (
    Lengths,
    Limits,
    Objectives,
    scaled_press,
)
from mech_twin.machines.compaction_press.design_search import BOUNDS, searched
from mech_twin.machines.compaction_press.metrics import cycle_metrics
from mech_twin.machines.compaction_press.parameters import press_constants
from mech_twin.parameters.load import machine_parameters
from mech_twin.parameters.written_configuration import write_configuration
from mech_twin.studies.design_scan import design_question

TURN = 2.0 * math.pi


class OwnPress:
    """The press by complex numbers and numerical derivatives, sharing nothing with the twin's kernels."""

    def __init__(self, parameters):
        self.p = parameters
        force, k = parameters.working_force, parameters.linkage
        self.w = parameters.drive.speed_rpm * TURN / 60.0
        self.sign = math.copysign(1.0, self.w)
        self.pivot = complex(k.pivot_x_m, k.pivot_y_m)
        way = np.linspace(0.0, TURN, 1441)
        heights = [self.height(self.sign * s) for s in way]
        self.top = self._turning(way[int(np.argmax(heights))], -1.0)
        self.bottom = self._turning(way[int(np.argmin(heights))], 1.0)
        self.y_t, self.y_b = self.height(self.sign * self.top), self.height(self.sign * self.bottom)
        self.y_c = self.y_t - force.contact_fraction * (self.y_t - self.y_b)
        end = self.top + (self.bottom - self.top) % TURN
        self.contact = brentq(lambda s: self.height(self.sign * s) - self.y_c, self.top, end, xtol=1e-13)
        self.travel = end - self.contact

    def _turning(self, guess, sense):
        found = minimize_scalar(
            lambda s: sense * self.height(self.sign * s),
            bounds=(guess - 0.01, guess + 0.01),
            method="bounded",
            options={"xatol": 1e-9},
        )
        low, high = found.x - 1e-4, found.x + 1e-4
        return brentq(lambda s: self._slope(self.height, self.sign * s), low, high, xtol=1e-13)

    @staticmethod
    def _slope(function, f, h=2e-4):
        return (8.0 * (function(f + h) - function(f - h)) - (function(f + 2 * h) - function(f - 2 * h))) / (12.0 * h)

    def joints(self, f):
        k = self.p.linkage
        a = k.crank_m * complex(math.cos(f), math.sin(f))
        to_pivot = self.pivot - a
        d = abs(to_pivot)
        inner = math.acos((k.coupler_m**2 + d * d - k.pendulum_m**2) / (2.0 * k.coupler_m * d))
        turn = -inner if k.branch == "open" else inner
        return a, a + k.coupler_m * to_pivot / d * complex(math.cos(turn), math.sin(turn))

    def points(self, f):
        a, b = self.joints(f)
        u, v = (b - a) / abs(b - a), (b - self.pivot) / abs(b - self.pivot)
        links, force = self.p.links, self.p.working_force
        crank = a / abs(a) * complex(links.crank.centroid_along_m, links.crank.centroid_across_m)
        plate = a + u * complex(links.plate.centroid_along_m, links.plate.centroid_across_m)
        pendulum = self.pivot + v * complex(links.pendulum.centroid_along_m, links.pendulum.centroid_across_m)
        return crank, plate, pendulum, a + u * complex(force.application_from_a_m, force.application_across_m), u, v

    def height(self, f):
        return self.points(f)[3].imag

    def potential(self, f):
        links = self.p.links
        masses = (links.crank.mass_kg, links.plate.mass_kg, links.pendulum.mass_kg)
        return 9.80665 * sum(m * point.imag for m, point in zip(masses, self.points(f)[:3], strict=True))

    def inertia(self, f):
        links = self.p.links
        total = links.crank.inertia_kg_m2
        for link, place, direction in ((links.plate, 1, 4), (links.pendulum, 2, 5)):
            speed = self._slope(lambda g, i=place: self.points(g)[i], f)
            rate = (self._slope(lambda g, i=direction: self.points(g)[i], f) / self.points(f)[direction]).imag
            total += link.mass_kg * abs(speed) ** 2 + link.inertia_kg_m2 * rate**2
        return total

    def pressing(self, s):
        return (s - self.contact) % TURN <= self.travel

    def torque(self, s):
        f, force = self.sign * s, self.p.working_force
        load = 0.0
        if self.pressing(s):
            depth = max((self.y_c - self.height(f)) / (self.y_c - self.y_b), 0.0)
            load = force.peak_n * depth**force.exponent
        lifted = self._slope(self.potential, f) - load * self._slope(self.height, f)
        return 0.5 * self.w**2 * self._slope(self.inertia, f, 2e-3) + lifted

    def angles(self, s):
        f = self.sign * s
        (a, b), u = self.joints(f), self.points(f)[4]
        v = b - self.pivot
        mu = abs(math.atan2((u.conjugate() * v).imag, (u.conjugate() * v).real))
        alpha = abs(math.atan2((a.conjugate() * u).imag, (a.conjugate() * u).real))
        return abs(math.atan2(u.imag, u.real)), min(mu, math.pi - mu), min(alpha, math.pi - alpha)


def largest(curve, low, high, count=181):
    """Return the largest value of a curve between two places: a fine grid, each near-best place refined."""
    places = np.linspace(low, high, count)
    values = np.array([curve(s) for s in places])
    best, step = values.max(), places[1] - places[0]
    for s in places[values > best - 1e-3 * np.ptp(values)]:
        bounds = (max(low, s - step), min(high, s + step))
        found = minimize_scalar(lambda x: -curve(x), bounds=bounds, method="bounded", options={"xatol": 1e-10})
        best = max(best, -found.fun)
    return best


def random_configuration(random):
    """Return a legal configuration that differs from the installed one in speed, force, masses and delta."""
    rpm = float(random.uniform(60.0, 420.0) * random.choice((-1.0, 1.0)))
    return machine_parameters(
        "compaction_press",
        None,
        {
            "drive.speed_rpm": rpm,
            "working_force.peak_n": float(random.uniform(2e3, 4e4)),
            "working_force.contact_fraction": float(random.uniform(0.1, 0.8)),
            "working_force.exponent": float(random.choice((0.5, 1.0, 2.0))),
            "working_force.application_from_a_m": float(random.uniform(0.2, 0.35)),
            "links.plate.mass_kg": float(random.uniform(20.0, 80.0)),
            "links.pendulum.mass_kg": float(random.uniform(2.0, 20.0)),
            "links.pendulum.centroid_along_m": float(random.uniform(0.05, 0.25)),
            "links.crank.centroid_along_m": float(random.uniform(0.0, 0.03)),
            "flywheel.non_uniformity": float(random.uniform(0.02, 0.2)),
        },
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_the_machine_searched_is_the_machine_written_and_holds_every_limit(seed, tmp_path):
    parameters = random_configuration(np.random.default_rng(seed))
    space = design_question("compaction_press").space()
    objective = Objectives._fields[seed % len(Objectives._fields)]
    (design,) = searched(parameters, space, (objective,), seed, 1)
    write_configuration("compaction_press", design.parameters, tmp_path / "found.yaml")
    written = machine_parameters("compaction_press", tmp_path / "found.yaml")
    report = cycle_metrics(written)
    assert written.drive == parameters.drive
    assert written.working_force.peak_n == parameters.working_force.peak_n
    assert written.working_force.exponent == parameters.working_force.exponent
    peak = max(report["drive_torque_peak_nm"], -report["drive_torque_min_nm"])
    assert design.objectives["peak_torque_nm"] == pytest.approx(peak, rel=1e-9)
    inertia = report["flywheel_inertia_kg_m2"]
    assert design.objectives["flywheel_inertia_kg_m2"] == pytest.approx(inertia, rel=1e-9)
    assert design.margins["gamma_max_deg"] == pytest.approx(report["gamma_margin_deg"], abs=1e-9)
    assert design.margins["stroke_m"] == pytest.approx(report["stroke_m"] - 0.05, abs=1e-12)
    own = OwnPress(written)
    gamma = math.degrees(largest(lambda s: own.angles(s)[0], 0.0, TURN, 721))
    assert gamma <= 20.0 + 1e-9
    assert math.degrees(-largest(lambda s: -own.angles(s)[1], 0.0, TURN, 721)) >= 50.0 - 1e-9
    assert own.y_t - own.y_b >= 0.05 - 1e-9
    at_bottom = own.angles(own.bottom)
    assert math.degrees(at_bottom[0]) <= 1.0 + 1e-6
    assert math.degrees(at_bottom[2]) >= 85.0 - 1e-6
    assert report["gamma_max_deg"] == pytest.approx(gamma, abs=1e-7)
    torque = max(
        largest(lambda s: abs(own.torque(s)), own.contact, own.contact + own.travel),
        largest(lambda s: abs(own.torque(s)), own.contact + own.travel, own.contact + TURN),
    )
    assert peak == pytest.approx(torque, rel=1e-6)
    force = 250.0 * own.travel / (own.y_c - own.y_b)
    assert design.objectives["mean_press_force_n"] == pytest.approx(force, rel=1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_a_design_with_the_configurations_lengths_is_the_configuration(seed):
    parameters = random_configuration(np.random.default_rng(seed))
    k = parameters.linkage
    lengths = Lengths(k.crank_m, k.pivot_x_m, k.pivot_y_m, k.pendulum_m)
    own = press_constants(parameters, fitted=False)[0]
    scaled = scaled_press(own, lengths)
    for part in ("bar", "crank", "plate", "pendulum"):
        assert tuple(getattr(scaled, part)) == pytest.approx(tuple(getattr(own, part)), rel=1e-14)
    assert configured_press(parameters, lengths).drive == parameters.drive


def test_bars_keep_their_mass_per_metre_and_the_crank_the_part_of_its_inertia_that_turns_with_the_pin():
    parameters = machine_parameters("compaction_press")
    press = scaled_press(press_constants(parameters, fitted=False)[0], Lengths(0.08, 0.7, 0.3, 0.4))
    assert press.plate.mass_kg == pytest.approx(80.0 * 0.7)
    assert press.plate.inertia_kg_m2 == pytest.approx(80.0 * 0.7**3 / 12.0)
    assert press.pendulum.mass_kg == pytest.approx(5.0 / 0.3 * 0.4)
    assert press.crank.inertia_kg_m2 == pytest.approx(0.002 + 5.0 * 0.08**2)
    assert press.along_m == pytest.approx(0.35)


@pytest.mark.slow
def test_the_curve_evaluated_in_bulk_is_the_one_of_the_written_configuration():
    random = np.random.default_rng(8)
    parameters = random_configuration(random)
    problem = design_problem(parameters, Limits()._asdict())
    low, high = np.array(list(BOUNDS.values())).T
    rows = random.uniform(low, high, (400, 4))
    found = evaluation(rows, problem, continuous=True)
    turning = np.flatnonzero((found.margins >= -0.5).all(axis=1) & np.isfinite(found.objectives).all(axis=1))[:10]
    turning = turning if len(turning) else np.flatnonzero(np.isfinite(found.objectives).all(axis=1))[:10]
    assert len(turning) > 0
    for place in turning:
        design = described(parameters, Lengths(*rows[place]), Limits())
        assert tuple(design.objectives.values()) == pytest.approx(found.objectives[place], rel=1e-9)
        assert tuple(design.margins.values()) == pytest.approx(found.margins[place], rel=1e-9, abs=1e-9)


@pytest.mark.slow
def test_a_layer_met_in_the_working_quarter_is_the_same_in_bulk_and_as_written():
    parameters = machine_parameters("compaction_press", None, {"working_force.working_quarter": True})
    row = np.array([[0.055, 0.5, 0.24, 0.295]])
    problem = design_problem(parameters, Limits()._asdict())
    design = described(parameters, Lengths(*row[0]), Limits())
    assert design.parameters.working_force.working_quarter
    found = evaluation(row, problem, continuous=True).objectives[0]
    assert tuple(design.objectives.values()) == pytest.approx(found, rel=1e-9)
    assert tuple(evaluation(row, problem).objectives[0]) == pytest.approx(found, rel=2e-2)


@pytest.mark.parametrize("speed_rpm", [300.0, pytest.param(-300.0, marks=pytest.mark.slow)])
def test_of_two_equal_lows_a_design_is_judged_at_the_one_of_its_own_run(speed_rpm):
    """Loaded at the pendulum's pin, every design passes its lowest point twice a turn."""
    pin = {"working_force.application_from_a_m": 0.5, "drive.speed_rpm": speed_rpm}
    parameters = machine_parameters("compaction_press", None, pin)
    problem = design_problem(parameters, Limits()._asdict())
    low, high = np.array(list(BOUNDS.values())).T
    rows = np.random.default_rng(1).uniform(low, high, (400, 4))
    rows = rows[np.isfinite(evaluation(rows, problem).objectives).all(axis=1)]
    assert len(rows) > 50
    curve, sampled = (evaluation(rows, problem, continuous=exact).objectives for exact in (True, False))
    own = np.array([tuple(described(parameters, Lengths(*row), Limits()).objectives.values()) for row in rows])
    assert curve == pytest.approx(own, rel=1e-9)
    assert sampled == pytest.approx(own, rel=5e-2)


def test_speed_and_force_of_the_configuration_enter_the_search():
    design = np.array([[0.055, 0.5, 0.24, 0.295]])
    reached = []
    for changes in ({}, {"drive.speed_rpm": 150.0}, {"working_force.peak_n": 20000.0}):
        parameters = machine_parameters("compaction_press", None, changes)
        problem = design_problem(parameters, Limits()._asdict())
        reached.append([evaluation(design, problem, continuous=c).objectives[0] for c in (False, True)])
    as_installed, slow, strong = np.array(reached)
    assert (slow[:, 1] > 2.0 * as_installed[:, 1]).all()  # the same work in a quarter of the kinetic energy
    assert (strong[:, 0] > 1.3 * as_installed[:, 0]).all()


@pytest.mark.parametrize(
    ("bounds", "limits", "word"),
    [
        ({"width": (0.1, 0.2)}, {}, "no variable 'width'"),
        ({"crank": (0.2, 0.1)}, {}, "bounds of crank: 0 < 0.2 <= 0.1 fails"),
        ({"crank": (-1.0, 0.1)}, {}, "0 < -1 <= 0.1 fails"),
        ({}, {"peak_n": 1.0}, "no limit 'peak_n'"),
        ({}, {"stroke_m": -1.0}, "limit stroke_m -1.0"),
    ],
)
def test_a_space_that_makes_no_sense_is_refused_by_name(bounds, limits, word):
    with pytest.raises(StudyError, match=word):
        design_question("compaction_press").space(bounds, limits)


def test_a_machine_without_a_design_question_says_so():
    with pytest.raises(StudyError, match="winding_drum: no design question; there is an answer for compaction_press"):
        design_question("winding_drum")
