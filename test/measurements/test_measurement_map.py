# SPDX-License-Identifier: Apache-2.0
"""The mapping file is checked line by line, and each refusal names file, key, value and what was expected."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from catalogue import NAMES, built
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.measurements.measurement_map import Channel, read_map
from mech_twin.measurements.units import UNITS, is_angle, joint_column, machine_columns, time_unit_in, unit_in, unit_of

GOOD: dict[str, Any] = {
    "machine": "vibration_crank",
    "time": {"column": "Time (s)", "unit": "ms"},
    "channels": [
        {"source": {"column": "a"}, "is": "linkage.crank.position", "unit": "deg", "zero": "per_run"},
        {
            "source": {"topic": "/b", "joint": "c", "field": "effort"},
            "is": "linkage.crank.effort",
            "unit": "A",
            "gain": "free",
        },
        {"source": {"topic": "/hits", "field": "stamp"}, "is": "event.blow.time"},
    ],
    "runs": ["one.tsv"],
}  # fmt: skip


def columns_of(name: str) -> Any:
    return machine_columns(built(name))


def written(tree: Any, folder: Path) -> Path:
    path = folder / "map.yaml"
    path.write_text(tree if isinstance(tree, str) else yaml.safe_dump(tree), encoding="utf-8")
    return path


def changed(place: int, **keys: Any) -> dict[str, Any]:
    channels = [dict(channel) for channel in GOOD["channels"]]
    channels[place] |= keys
    return {**GOOD, "channels": channels}


def test_the_map_of_the_page_is_read(tmp_path: Path) -> None:
    found = read_map(written(GOOD, tmp_path), columns_of)
    assert [channel.quantity for channel in found.channels] == [channel["is"] for channel in GOOD["channels"]]
    assert found.channels[0].zero == "per_run"
    assert found.time.column == "Time (s)"
    assert found.runs == ("one.tsv",)


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        (changed(0, unit="mm"), ("channels.0.unit", "'mm'", "is in rad", "deg")),
        (changed(0, unit="degrees"), ("channels.0.unit", "'degrees'", "expected one of")),
        (changed(0, **{"is": "linkage.crank.positoin"}), ("channels.0.is", "positoin", "linkage.crank.position")),
        (changed(0, sign=2), ("channels.0.sign", "2", "1 or -1")),
        (changed(0, zero="unknown"), ("channels.0.zero", "'unknown'", "free")),
        (changed(1, gain=0.0), ("channels.1.gain", "0.0", "not 0")),
        (changed(1, gain=True), ("channels.1.gain", "True")),
        (changed(0, lag_s=99.0), ("channels.0.lag_s", "99.0", "10")),
        (changed(0, colour="red"), ("unknown key 'channels.0.colour'", "'red'")),
        (changed(0, source={"joint": "c"}), ("channels.0.source", "topic", "column")),
        (changed(0, source={"topic": "/b"}), ("channels.0.source", "field")),
        (changed(1, source={"column": "a"}), ("'a' stands twice",)),
        (changed(1, source={"column": "Time (s)"}), ("'Time (s)' is the column of the time",)),
        ({**changed(1, source={"column": "time_s"}), "time": {}}, ("'time_s' is the column of the time",)),
        ({**GOOD, "machine": "press"}, ("no machine 'press'",)),
        ({**GOOD, "channels": []}, ("channels", "at least 1")),
        ({**GOOD, "time": {"stamps": "clock"}}, ("time.stamps", "'clock'", "'header' or 'log'")),
        ({**GOOD, "time": {"column": "t", "unit": "week"}}, ("time.unit", "'week'", "ms")),
        ("machine: [", ("not a valid YAML file",)),
        ("- 1", ("expected keys",)),
        ("machine: a\nmachine: b", ("stands twice",)),
    ],
)  # fmt: skip
def test_a_wrong_map_is_refused_in_one_line(tree: Any, words: tuple[str, ...], tmp_path: Path) -> None:
    path = written(tree, tmp_path)
    with pytest.raises(ConfigurationError) as refused:
        read_map(path, lambda name: columns_of(name) if name in NAMES else built(name))
    line = str(refused.value)
    assert "\n" not in line
    for word in words if "no machine" in words[0] else (str(path), *words):
        assert word in line


def test_a_wrong_channel_is_no_complaint_of_the_list_that_holds_it(tmp_path: Path) -> None:
    path = written({**GOOD, "channels": [{**GOOD["channels"][0], "unit": "bar"}]}, tmp_path)
    with pytest.raises(ConfigurationError) as refused:
        read_map(path, columns_of)
    assert str(refused.value).count("key '") == 1


units = st.sampled_from([name for name, about in UNITS.items() if about.si in ("rad", "rad/s", "m", "m/s")])
numbers = st.floats(-1e3, 1e3)


@given(units, st.sampled_from([1, -1]), numbers, st.floats(1e-3, 1e3) | st.floats(-1e3, -1e-3), st.lists(numbers))
def test_what_a_channel_shows_is_read_back(unit: str, sign: int, zero: float, gain: float, values: list[float]) -> None:
    tree = {"source": {"column": "a"}, "is": "x", "unit": unit, "sign": sign, "zero": zero, "gain": gain}
    channel = Channel.model_validate(tree)
    motion = np.array(values)
    shown = channel.shown(motion)
    size = abs(gain) * channel.si_factor * (1.0 + np.abs(shown) + abs(zero))
    assert np.all(np.abs(channel.to_machine(shown) - motion) <= 1e-13 * size)


def test_a_unit_counts_as_many_si_units_as_its_definition_says() -> None:
    assert UNITS["deg"].factor * 360.0 == pytest.approx(UNITS["turn"].factor, rel=1e-15)
    assert UNITS["rpm"].factor * 60.0 == pytest.approx(UNITS["turn"].factor, rel=1e-15)
    assert UNITS["mm"].factor * 1000.0 == UNITS["m"].factor


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("Slide position (mm)", "mm"), ("Wheel Speed (deg/s)", "deg/s"), ("torque [Nm]", "N.m"), ("x_m", "m"),
        ("crank_rad_per_s", "rad/s"), ("speed, rpm", "rpm"), ("Current (A)", "A"), ("Force [N]", "N"),
        ("Winkel [°]", "deg"), ("speed (rad/sec)", "rad/s"), ("name", None), ("position", None), ("alarm", None),
    ],
)  # fmt: skip
def test_units_are_found_in_headers(header: str, unit: str | None) -> None:
    assert unit_in(header) == unit


def test_units_of_time_are_found_in_headers() -> None:
    headers = {"Time (s)": "s", "t_ms": "ms", "stamp [us]": "us", "Time [h]": "h", "t (minutes)": "min", "Wheel": None}
    headers |= {"time_hrs": "h", "Time (mins)": "min"}  # not taken for seconds
    assert {text: time_unit_in(text) for text in headers} == headers


@pytest.mark.parametrize("name", NAMES)
def test_the_speed_of_every_column_has_the_unit_of_its_differences(name: str) -> None:
    columns = machine_columns(built(name))
    frame = next(iter(frames(built(name), 0.0)))
    joints = {f"linkage.{joint}" for joint in frame.linkage.joints}
    for joint in joints:
        assert columns[f"{joint}.velocity"] == f"{columns[f'{joint}.position']}/s"
        assert joint_column(f"{joint}.effort") is not None
    power = {"rad/s": "N.m", "m/s": "N"}
    assert all(columns[f"{joint}.effort"] == power[columns[f"{joint}.velocity"]] for joint in joints)


@pytest.mark.parametrize("name", NAMES)
def test_a_joint_that_slides_in_the_mechanism_is_measured_in_metres(name: str) -> None:
    columns, tree = machine_columns(built(name)), built(name).mechanism
    assert tree is not None
    for joint in {joint.name for joint in tree.joints if f"linkage.{joint.name}.position" in columns}:
        assert columns[f"linkage.{joint}.position"] == ("m" if joint in tree.sliding_joints else "rad")


def test_a_slope_over_an_angle_is_no_angle() -> None:
    assert unit_of("forces.reduced_inertia_slope_kg_m2_per_rad") == "kg.m2/rad"
    assert not is_angle("forces.reduced_inertia_slope_kg_m2_per_rad")
