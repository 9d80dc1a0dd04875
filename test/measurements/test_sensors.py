# SPDX-License-Identifier: Apache-2.0
"""A run seen through sensors and read back by the same map is the run, within what the sensors state."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from catalogue import built
from hypothesis import given, settings
from hypothesis import strategies as st

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_events, frame_numbers
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.runs import MeasuredRun, read_run
from mech_twin.measurements.sensors import Reading, SensorBench, sensor_table
from mech_twin.measurements.tables import TableReader
from mech_twin.measurements.units import UNITS, machine_columns
from mech_twin.samples import Frame

pytest.importorskip("pyarrow")
MACHINE, DURATION_S, SIGMAS = "vibration_crank", 1.0, 6.0
TURN = 2.0 * np.pi


@cache
def run(name: str = MACHINE, duration_s: float = DURATION_S) -> tuple[Frame, ...]:
    return tuple(frames(built(name), duration_s))


@cache
def columns() -> dict[str, Any]:
    rows = [dict(frame_numbers(frame)) for frame in run()]
    found = {name: np.array([row[name] for row in rows]) for name in ("time_s", *COLUMNS, "linkage.rod.position")}
    return {name: np.unwrap(values) if "crank.position" in name else values for name, values in found.items()}


def own(column: str, at_s: Any) -> Any:
    """Return a column of the run at any instant, straight between the steps."""
    return np.interp(at_s, columns()["time_s"], columns()[column])


def channel(source: str, column: str, **keys: Any) -> dict[str, Any]:
    return {"source": {"column": source}, "is": column, **keys}


def sensors(*channels: dict[str, Any], machine: str = MACHINE, **keys: Any) -> MeasurementMap:
    return MeasurementMap.model_validate({"machine": machine, "channels": channels, **keys})


def readings(given_sensors: MeasurementMap, seed: int = 0, duration_s: float = DURATION_S) -> list[Reading]:
    name = given_sensors.machine
    bench = SensorBench(given_sensors, machine_columns(built(name)), built(name).coupling_step_s, seed)
    shown = [reading for frame in run(name, duration_s) for reading in bench.observe(frame)]
    return [*shown, *bench.rest()]


def read_back(given_sensors: MeasurementMap, path: Path, seed: int = 0) -> MeasuredRun:
    with sensor_table(path, given_sensors) as writer:
        for reading in readings(given_sensors, seed):
            writer.read(reading)
    return read_run(TableReader(path), given_sensors)


def straight_error(column: str) -> float:
    """Return how far a straight line between two steps can be off: an eighth of the largest second difference."""
    return float(np.abs(np.diff(columns()[column], 2)).max()) / 8.0


COLUMNS = {
    "linkage.crank.position": ("rad", "deg", "turn"),
    "linkage.slider.position": ("m", "mm"),
    "linkage.slider.velocity": ("m/s", "mm/s"),
    "linkage.crank.effort": ("N.m",),
}


@st.composite
def sensor(draw: st.DrawFn, place: int) -> dict[str, Any]:
    column = draw(st.sampled_from(sorted(COLUMNS)))
    rate_hz, gain, unit = (
        draw(st.floats(15.0, 900.0)),
        draw(st.floats(0.1, 10.0)),
        draw(st.sampled_from(COLUMNS[column])),
    )
    size = 1.0 / gain / UNITS[unit].factor  # what the channel shows of one SI unit
    return channel(
        f"channel {place}",
        column,
        unit=unit,
        sign=draw(st.sampled_from([1, -1])),
        zero=draw(st.floats(-20.0, 20.0)),
        gain=gain,
        lag_s=draw(st.floats(-0.02, 0.05)),
        sigma=draw(st.sampled_from([0.0, 1e-3, 0.1])) * size,
        quantum=draw(st.sampled_from([0.0, 1e-3, 0.02])) * size,
        rate_hz=rate_hz,
        jitter_s=draw(st.floats(0.0, 0.3)) / rate_hz,
        drop=draw(st.floats(0.0, 0.3)),
    )


@pytest.mark.slow
@settings(max_examples=25)
@given(
    st.integers(1, 3).flatmap(lambda n: st.tuples(*(sensor(i) for i in range(n)))), st.integers(0, 2**31), st.booleans()
)
def test_the_round_trip_gives_the_run_within_the_sensors_statement(
    tmp_path_factory: pytest.TempPathFactory, channels: tuple[dict[str, Any], ...], seed: int, as_text: bool
) -> None:
    given_sensors = sensors(*channels)
    path = tmp_path_factory.mktemp("table") / ("a.csv" if as_text else "a.parquet")
    for measured in read_back(given_sensors, path, seed).channels:
        spec = measured.channel
        assert np.all(np.diff(measured.times_s) > 0.0)
        expected = own(spec.quantity, measured.times_s)
        off = np.abs(measured.values - expected)
        if spec.quantity == "linkage.crank.position":
            off = np.abs((off + 0.5 * TURN) % TURN - 0.5 * TURN)
        stated = (SIGMAS * (spec.sigma or 0.0) + 0.5 * spec.quantum) * abs(float(spec.gain)) * spec.si_factor
        assert off.max() <= stated + straight_error(spec.quantity) + 1e-9


def test_a_sensor_without_faults_shows_the_steps_themselves() -> None:
    shown = readings(sensors(channel("a", "linkage.slider.position", rate_hz=1000.0)))
    values = [frame.linkage.position[2] for frame in run()]
    assert [reading.values[0] for reading in shown] == pytest.approx(values, rel=1e-15)
    assert [reading.time_s for reading in shown] == pytest.approx([frame.linkage.time_s for frame in run()], abs=1e-12)


def test_between_the_steps_the_motion_is_followed_to_fourth_order() -> None:
    shown = readings(sensors(channel("a", "linkage.slider.position", rate_hz=777.0)))
    speed = built(MACHINE).parameters.drive.speed_rad_per_s  # type: ignore[attr-defined]
    exact = np.array([built(MACHINE).analyse(speed * reading.time_s)["follower_m"] for reading in shown])
    off = np.abs(np.array([reading.values[0] for reading in shown]) - exact)
    assert off.max() < 1e-9 < 0.01 * straight_error("linkage.slider.position")


def test_statistics_are_those_of_the_sensor() -> None:
    spec = {"rate_hz": 900.0, "sigma": 0.02, "drop": 0.2, "jitter_s": 1e-4}
    shown = readings(sensors(channel("a", "linkage.rod.position", **spec)))
    times = np.array([reading.time_s for reading in shown])
    noise = np.array([reading.values[0] for reading in shown]) - own("linkage.rod.position", times)
    assert noise.std() == pytest.approx(0.02, rel=0.1)
    assert abs(noise.mean()) < 0.02 * 4.0 / len(noise) ** 0.5
    assert len(shown) == pytest.approx(0.8 * 900.0, rel=0.08)
    off = times * 900.0 - np.round(times * 900.0)
    assert off.std() == pytest.approx(1e-4 * 900.0, rel=0.15)


def test_the_same_seed_shows_the_same_and_a_channel_does_not_depend_on_the_others() -> None:
    one = channel("a", "linkage.slider.position", sigma=0.1, jitter_s=1e-4, drop=0.1, rate_hz=300.0)
    other = channel("b", "linkage.rod.position", sigma=0.1, rate_hz=90.0)
    both = readings(sensors(one, other), seed=5)
    alone = readings(sensors(one), seed=5)
    assert [r for r in both if r.sources[0].column == "a"] == alone
    assert readings(sensors(one), seed=6) != alone
    assert readings(sensors(one, other), seed=5) == both


def test_readings_come_in_order_of_their_stamps() -> None:
    late = channel("a", "linkage.rod.position", lag_s=0.2, rate_hz=50.0)
    early = channel("b", "linkage.slider.position", lag_s=-0.1, rate_hz=333.0)
    times = [reading.time_s for reading in readings(sensors(late, early))]
    assert times == sorted(times)
    assert times[-1] > DURATION_S > 0.0 > times[0]


def test_events_are_shown_with_their_own_time_and_lag() -> None:
    name, duration_s = "impact_mass", 0.5
    mine = [event for frame in run(name, duration_s) for event in frame_events(frame) if event.kind == "impact"]
    shown = readings(
        sensors(
            channel("when", "event.impact.time", lag_s=0.002),
            channel("speed (mm/s)", "event.impact.pre_velocity", unit="mm/s", lag_s=0.002),
            machine=name,
        ),
        duration_s=duration_s,
    )
    when = [reading for reading in shown if reading.sources[0].column == "when"]
    speed = [reading.values[0] for reading in shown if reading.sources[0].column != "when"]
    assert len(mine) > 3
    assert [reading.values[0] for reading in when] == [event.time_s for event in mine]
    assert [reading.time_s for reading in when] == [event.time_s + 0.002 for event in mine]
    assert speed == pytest.approx([1e3 * event.pre_velocity_m_per_s for event in mine], rel=1e-12)


@pytest.mark.parametrize(
    ("channels", "words"),
    [
        ((channel("a", "linkage.rod.position", zero="free"),), ("channels.0.zero", "'free'")),
        ((channel("a", "linkage.rod.position", lag_s="per_run"),), ("channels.0.lag_s", "'per_run'")),
        (
            tuple(
                {**channel("", "linkage.rod.position", rate_hz=rate), "source": {"topic": "/t", "field": field}}
                for field, rate in (("vector.x", 10.0), ("vector.y", 20.0))
            ),
            ("channels.1.rate_hz", "20", "expected 10", "'/t'"),
        ),
    ],
)  # fmt: skip
def test_sensors_that_cannot_be_are_refused(channels: tuple[dict[str, Any], ...], words: tuple[str, ...]) -> None:
    with pytest.raises(ConfigurationError) as refused:
        SensorBench(sensors(*channels), machine_columns(built(MACHINE)), 1e-3)
    assert all(word in str(refused.value) for word in words)
