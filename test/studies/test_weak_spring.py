# SPDX-License-Identifier: Apache-2.0
"""A breaker with hidden parameters: its spring weakens, the fault is found, and the advice brings its seat back."""

from __future__ import annotations

import numpy as np
import pytest
from catalogue import built

from mech_twin.capabilities.cycle import Array
from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.studies.advice import AdviceOutput, AdviceWish
from mech_twin.studies.advice_search import advice_model, recommendation
from mech_twin.studies.live_monitor import changes_by_faults, has_news
from mech_twin.studies.monitoring.baseline import fitted_baseline
from mech_twin.studies.monitoring.charts import chart_limits
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.findings import Findings
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.sensing import MonitoredMachine, seen_run
from mech_twin.studies.monitoring.sensor_design import machine_signatures

NAME, SPRING, PRELOAD, FIGURE = (
    "mb10_breaker",
    "body.spring_rate_n_per_m",
    "body.preload_deflection_m",
    "body_mean_rad",
)
HIDDEN = {"body.inertia_kg_m2": 6.2, "tool.restitution": 0.36}
HEALTHY_S, CHANGE_S, END_S = 45.0, 8.0, 20.0
FAULTS = (
    share_of_key("spring_soft", "", SPRING, (-0.4, -0.2, -0.1)),
    share_of_key("tool_worn", "", "tool.overtravel_m", (-0.4, -0.2, -0.1)),
    added_to_key("bearing_friction", "", "friction.coulomb_nm", "N.m", (0.5, 1.0, 2.0)),
)
SENSORS = MeasurementMap.model_validate(
    {
        "machine": NAME,
        "channels": [
            {"source": {"column": column}, "is": column, "rate_hz": rate, "sigma": sigma}
            for column, rate, sigma in (
                ("linkage.crank.position", 500.0, 1e-3),
                ("motor.rotor.effort", 500.0, 0.2),
                ("body.body.position", 1000.0, 5e-4),
            )
        ],
    }
)


class FewFaults(MonitoredMachine):
    """The breaker with the faults that are told apart here."""

    @property
    def faults(self) -> tuple[MachineFault, ...]:
        return FAULTS


class Plant:
    """The machine with hidden parameters, seen through its sensors."""

    def __init__(self, model: MonitoredMachine) -> None:
        self.model, self.random = model, np.random.default_rng(5)

    def vectors(self, duration_s: float, change_s: float = 0.0, **changes: float) -> list[FeatureVector]:
        """Return cycles of a run in which keys change."""
        begin_s, build = self.model.declared.run_up_s, self.model.entry.build
        later = build(self.model.varied(HIDDEN | changes))
        seen = seen_run(
            build(self.model.varied(HIDDEN)),
            SENSORS,
            begin_s + duration_s,
            random=self.random,
            changes=[(begin_s + change_s, later)] if changes else (),
            begin_s=begin_s,
        )
        return self.model.vectors(seen)


def figures(vectors: list[FeatureVector]) -> Array:
    return np.array([vector.values[vector.names.index(FIGURE)] for vector in vectors])


def last_findings(monitor: Monitor, vectors: list[FeatureVector]) -> Findings:
    return [monitor.observe(vector) for vector in vectors][-1]


@pytest.mark.slow
def test_a_weak_spring_is_found_and_the_advice_on_the_preload_keeps_its_promise() -> None:
    model = FewFaults(NAME, built(NAME).parameters, SENSORS)
    plant = Plant(model)
    healthy = plant.vectors(HEALTHY_S)
    wanted = float(figures(healthy).mean())
    baseline, innovations = fitted_baseline(healthy)
    limits = chart_limits(baseline, innovations, 1e4)
    setup = MonitorSetup(NAME, baseline, limits, machine_signatures(model, baseline.names), 12)
    monitor = Monitor(setup)
    weak = {SPRING: 0.8 * float(built(NAME).parameters.body.spring_rate_n_per_m)}
    vectors = plant.vectors(END_S, CHANGE_S, **weak)
    found = last_findings(monitor, vectors)
    assert found.finding == "spring_soft"
    assert found.candidates[0].size == pytest.approx(-0.2, abs=0.03)
    assert has_news(monitor.lives.values())
    assert changes_by_faults(model.parameters, FAULTS, monitor, found) == {}
    monitor.acknowledge("spring_soft", found.time_s)
    assert not has_news(monitor.lives.values())
    changes = changes_by_faults(model.parameters, FAULTS, monitor, found)
    assert changes == {SPRING: pytest.approx(weak[SPRING], rel=0.04)}

    output = AdviceOutput(key=PRELOAD, low=0.010, high=0.022, value=0.0139)
    wish = AdviceWish(figure=FIGURE, wanted=wanted, output=output, step_share=0.5)
    asked = advice_model(model.entry, model.parameters, wish, model.columns).under(changes)
    now = figures(vectors)[-20:]
    advice = recommendation(asked, output.value, now, found.time_s)
    assert advice is not None
    assert SPRING in advice.evidence
    after = figures(plant.vectors(10.0, 0.1, **weak, **{PRELOAD: advice.proposed}))[-60:]
    gain = abs(now.mean() - wanted) - abs(after.mean() - wanted)
    noise = 2.0 * float(np.hypot(now.std() / np.sqrt(len(now)), after.std() / np.sqrt(len(after))))
    assert advice.gain_low - noise <= gain <= advice.gain_high + noise
    assert abs(after.mean() - wanted) < 0.2 * abs(now.mean() - wanted)
