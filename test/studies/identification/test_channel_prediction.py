# SPDX-License-Identifier: Apache-2.0
"""What a channel is predicted to show is what the sensors of a run show, sample by sample."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from catalogue import built

from mech_twin.engine.run import frames
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.sensors import SensorBench
from mech_twin.measurements.units import machine_columns
from mech_twin.samples import Frame
from mech_twin.studies.identification.fit_runs import ColumnCurves, needed_columns
from mech_twin.studies.named_rollouts import rollout

DURATION_S = 0.4
SHOWN = {
    "zero": -3.0,
    "gain": 2.5,
    "sign": -1,
    "lag_s": 0.0034,
    "rate_hz": 731.0,
    "jitter_s": 2e-4,
    "drop": 0.1,
}
CHANNELS = {
    "vibration_crank": ("linkage.crank.position", "linkage.slider.velocity", "forces.shaking_force_x_n"),
    "mb10_breaker": ("linkage.crank.position", "linkage.body.position", "linkage.body.velocity"),
    "impact_mass": ("linkage.mass.position", "forces.drive_force_n"),
}


@cache
def run(name: str) -> tuple[Frame, ...]:
    return tuple(frames(built(name), DURATION_S))


def sensors(name: str) -> MeasurementMap:
    channels: list[dict[str, Any]] = [
        {"source": {"column": column}, "is": column, **SHOWN, "rate_hz": 731.0 + 13.0 * i}
        for i, column in enumerate(CHANNELS[name])
    ]
    return MeasurementMap.model_validate({"machine": name, "channels": channels})


@pytest.mark.slow
@pytest.mark.parametrize("name", CHANNELS)
def test_a_channel_shows_the_roll_out_as_the_sensors_show_the_run(name: str) -> None:
    given = sensors(name)
    bench = SensorBench(given, machine_columns(built(name)), built(name).coupling_step_s)
    readings = [reading for frame in run(name) for reading in bench.observe(frame)] + list(bench.rest())
    curves = ColumnCurves(rollout(name, DURATION_S, columns=needed_columns(list(CHANNELS[name]))))
    for channel in given.channels:
        own = [reading for reading in readings if reading.sources == (channel.source,)]
        assert len(own) > 200
        stamps = np.array([reading.time_s for reading in own])
        shown = np.array([reading.values[0] for reading in own])
        off = np.abs(channel.shown(curves.at(channel.quantity, stamps - SHOWN["lag_s"])) - shown)
        if channel.quantity == "forces.drive_force_n":  # at a jump, rounding decides
            off = off[~curves.beside_event(stamps - SHOWN["lag_s"], 1e-9)]
        assert off.max() <= 1e-9 * np.abs(shown).max()


def test_beside_an_event_is_within_the_guard_of_one_and_nowhere_else() -> None:
    curves = ColumnCurves(rollout("impact_mass", DURATION_S, columns=["linkage.mass.position"]))
    times = np.linspace(0.0, DURATION_S, 4001)
    nearest = np.array([np.abs(curves.rollout.event_numbers.time_s - time).min() for time in times])
    found = curves.beside_event(times, 2e-3)
    assert (found == (nearest <= 2e-3)).all()
    assert found.any()
    assert not found.all()


def test_events_of_a_kind_come_in_order_with_their_speeds() -> None:
    curves = ColumnCurves(rollout("impact_mass", DURATION_S))
    fields = ("time", "pre_velocity", "post_velocity")
    impacts = {field: curves.of_events("impact", field) for field in fields}
    assert (np.diff(impacts["time"]) >= 0.0).all()
    fast = np.abs(impacts["pre_velocity"]) > 1.0
    restitution = built("impact_mass").parameters.restitution  # type: ignore[attr-defined]
    np.testing.assert_allclose(-impacts["post_velocity"][fast], restitution * impacts["pre_velocity"][fast], rtol=1e-9)


@pytest.mark.parametrize("name", CHANNELS)
def test_events_as_arrays_are_the_events(name: str) -> None:
    found = rollout(name, DURATION_S, columns=[])
    events, numbers = found.stepped_events, found.event_numbers
    assert [(step, event.time_s, event.kind) for step, event in events] == list(
        zip(numbers.step.tolist(), numbers.time_s.tolist(), numbers.kind.tolist(), strict=True)
    )
    for field in ("pre_velocity_m_per_s", "post_velocity_m_per_s", "impulse_ns"):
        assert [getattr(event, field) for _, event in events] == getattr(numbers, field).tolist()
