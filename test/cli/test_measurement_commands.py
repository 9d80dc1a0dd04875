# SPDX-License-Identifier: Apache-2.0
"""Measurements on the command line: simulated through sensors, mapped, examined; faults in one line each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import yaml
from command_line import mech_twin

from mech_twin import simulate
from mech_twin.cli import measured

pytest.importorskip("pyarrow")
pytestmark = [pytest.mark.usefixtures("ros_domain"), pytest.mark.slow]
SENSORS: dict[str, Any] = {
    "machine": "vibration_crank",
    "time": {"column": "t_ms", "unit": "ms"},
    "channels": [
        {
            "source": {"topic": "/plant/wheel", "joint": "main_shaft", "field": "position", "column": "Wheel (deg)"},
            "is": "linkage.crank.position", "unit": "deg", "zero": 33.0, "rate_hz": 200.0, "quantum": 0.05,
        },
        {
            "source": {"topic": "/plant/slide", "field": "data", "column": "Slide (mm)"},
            "is": "linkage.slider.position", "unit": "mm", "sign": -1, "sigma": 0.2, "rate_hz": 90.0,
            "lag_s": 0.004, "drop": 0.05,
        },
        {
            "source": {"topic": "/plant/foot", "field": "wrench.force.y", "column": "Foot (N)"},
            "is": "forces.shaking_force_y_n", "rate_hz": 500.0,
        },
    ],
}  # fmt: skip
BAG = Path(__file__).resolve().parents[2] / "bags" / "mb10_breaker"
CRANK, SLIDER = "linkage.crank.position", "linkage.slider.position"


def written(path: Path, tree: dict[str, Any]) -> Path:
    path.write_text(yaml.safe_dump(tree, sort_keys=False), encoding="utf-8")
    return path


class Plant(NamedTuple):
    map: Path
    bag: Path
    table: Path


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Plant:
    folder = tmp_path_factory.mktemp("plant")
    found = Plant(written(folder / "sensors.yaml", SENSORS), folder / "bag", folder / "run.parquet")
    words = ("--sensors", found.map, "--bag", found.bag, "--table", found.table, "--seed", "3", "--json")
    run = mech_twin("simulate", "vibration_crank", "--duration", "2", "--one-step", *words)
    assert run.code == 0, run.err
    return found


def test_bag_and_table_show_the_same_samples(plant: Plant) -> None:
    from mech_twin.measurements.runs import read_run
    from mech_twin.results.opened_runs import configured_map, opened_run

    given = configured_map(plant.map)
    with opened_run(plant.bag) as bag, opened_run(plant.table) as table:
        of_bag, of_table = read_run(bag, given), read_run(table, given)
    for one, other in zip(of_bag.channels, of_table.channels, strict=True):
        assert np.array_equal(one.values, other.values)
        assert np.abs(one.times_s - other.times_s).max() < 1e-9  # a stamp holds nanoseconds
    assert [len(channel.values) for channel in of_bag.channels][::2] == [401, 1001]


def test_a_recording_of_simulated_sensors_is_told_as_the_twins_own(plant: Plant) -> None:
    assert "recorded by mech_twin\n" in mech_twin("info", plant.bag).out


def test_the_map_that_is_proposed_for_a_table_is_read_and_right(plant: Plant, tmp_path: Path) -> None:
    out = tmp_path / "map.yaml"
    found = mech_twin("map", plant.table, "vibration_crank", "--out", out, "--json")
    assert found.code == 0, found.err
    document = json.loads(found.out)
    assert yaml.safe_load(document["map"]) == yaml.safe_load(out.read_text(encoding="utf-8"))
    wheel, slide = yaml.safe_load(document["map"])["channels"]
    assert (wheel["is"], wheel["unit"], wheel["zero"]) == (CRANK, "deg", "per_run")
    assert (slide["is"], slide["unit"], slide["sign"], slide["zero"]) == (SLIDER, "mm", -1, "free")
    assert document["problems"] == []
    assert "gaps" in document["channels"][1]["flaws"][0]
    again = mech_twin("info", plant.table, "--map", out, "--json")
    assert again.code == 0, again.err
    assert json.loads(again.out)["channels"] == document["channels"]


def test_the_map_that_is_proposed_for_a_bag_names_the_unit_that_is_wrong(plant: Plant) -> None:
    found = mech_twin("map", plant.bag, "vibration_crank")
    assert found.code == 0
    assert "joint: main_shaft" in found.out
    assert "expected unit deg?" in found.err


def test_a_bag_of_the_twins_own_topics_maps_itself(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    assert mech_twin("simulate", "vibration_crank", "--duration", "1", "--bag", bag, "--json").code == 0
    document = json.loads(mech_twin("map", bag, "vibration_crank", "--json").out)
    channels = yaml.safe_load(document["map"])["channels"]
    assert {CRANK, SLIDER, "motor.motor.velocity", "linkage.crank.effort"} <= {channel["is"] for channel in channels}
    assert all(channel.keys() == {"source", "is"} for channel in channels)
    assert document["problems"] == []


def test_a_bag_of_the_twin_identifies_its_own_keys_and_its_dead_columns_are_not_proposed(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    run = mech_twin(
        "simulate", "vibration_crank", "--duration", "4", "--one-step", "--bag", bag, "--set", "crank_m=0.13", "--json"
    )
    assert run.code == 0, run.err
    found = mech_twin("identify", "vibration_crank", bag, "--free", "crank_m", "--cores", "1")
    assert found.code == 0, found.err
    told = [line.strip() for line in found.err.splitlines()]
    assert "is: forces.guide.force_x_n" in told
    assert "#   is: forces.guide.moment_nm" in told
    assert sum("motor.motor.velocity: left out" in line for line in told) == 1


def plain_bag(directory: Path, stamped: bool) -> Path:
    """Write a crank, a slider without efforts and a load cell about the shaft, as robots publish them."""
    from geometry_msgs.msg import WrenchStamped
    from rclpy.serialization import serialize_message
    from recordings import Entry, written_bag
    from sensor_msgs.msg import JointState

    entries = list[Entry]()
    for step, sample in enumerate(simulate("vibration_crank", 1.0).samples.to_pandas().to_dict("records")):
        state, cell, log_ns = JointState(), WrenchStamped(), 1_700_000_000 * 10**9 + step * 10**6
        state.name, state.effort = ["wheel", "ram"], [float("nan")] * 2
        state.position, state.velocity = ([sample[f"linkage.{of}.{field}"] for of in ("crank", "slider")]
                                          for field in ("position", "velocity"))  # fmt: skip
        cell.wrench.force.x, cell.wrench.torque.z = sample["forces.shaking_force_y_n"], sample["linkage.crank.effort"]
        for topic, message in (("/plant/states", state), ("/plant/crank_cell", cell)):
            if stamped:
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(log_ns, 10**9)
            kind = type(message).__name__
            package = "sensor_msgs" if message is state else "geometry_msgs"
            entries.append(Entry(topic, f"{package}/msg/{kind}", log_ns, serialize_message(message)))
    return written_bag(directory, entries)


@pytest.mark.parametrize("stamped", [True, False])
def test_a_column_without_numbers_or_stamps_or_of_another_quantity_is_not_proposed(
    stamped: bool, tmp_path: Path
) -> None:
    bag = plain_bag(tmp_path / "bag", stamped)
    found = mech_twin("map", bag, "vibration_crank", "--json")
    assert found.code == 0, found.err
    document = json.loads(found.out)
    proposed = yaml.safe_load(document["map"])
    assert proposed["time"]["stamps"] == ("header" if stamped else "log")
    assert document["problems"] == []  # a column of NaN is not in the map, so that the rest of it is judged
    torques = [each["source"]["field"] for each in proposed["channels"] if each["is"] == "linkage.crank.effort"]
    assert torques == ["wrench.torque.z"]  # N m; neither the NaN efforts of the states, nor a force in N
    assert not any("effort" in str(each["source"]) for each in proposed["channels"])


def test_a_channel_that_is_zero_throughout_leaves_its_place_to_no_other() -> None:
    """No torque acts on the rocker: its effort is 0, and a force of a pin is none."""
    proposed = yaml.safe_load(json.loads(mech_twin("map", BAG, "mb10_breaker", "--json").out)["map"])
    assert "linkage.crank.effort" in {each["is"] for each in proposed["channels"]}
    assert "linkage.rocker.effort" not in {each["is"] for each in proposed["channels"]}


def test_a_table_of_every_sample_holds_the_run(tmp_path: Path) -> None:
    from pyarrow import parquet

    path = tmp_path / "run.parquet"
    words = ("simulate", "winding_drum", "--duration", "0.2", "--json", "--samples")
    samples = json.loads(mech_twin(*words, "--table", path).out)["samples"]
    assert parquet.read_table(path).to_pydict() == samples


def test_a_change_is_recorded_so_that_the_run_can_be_computed_again(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    change = ("--change", "body.spring_rate_n_per_m=-20%@0.15")
    assert mech_twin("simulate", "mb10_breaker", "--duration", "0.3", "--bag", bag, "--json", *change).code == 0
    compared = json.loads(mech_twin("replay", bag, "--resimulate", "--json").out)
    assert compared["identical"]
    assert (compared["parameter_changes"], compared["steps_compared"]) == (1, 301)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("simulate", "vibration_crank", "--duration", "1", "--sensors", "{map}"), ("--sensors", "--bag or --table")),
        (("simulate", "winding_drum", "--duration", "1", "--sensors", "{map}", "--table", "{new}.csv"), ("'machine'",)),
        (("simulate", "winding_drum", "--duration", "1", "--table", "{new}.xls"), (".xls", ".parquet")),
        (("simulate", "winding_drum", "--duration", "1", "--change", "x=1"), ("--change x=1", "KEY=VALUE@SECONDS")),
        (("map", "{map}.csv", "vibration_crank"), ("no such table",)),
        (("map", "{table}", "impact_mass"), ("none of its channels", "'Wheel (deg)'", "write the map by hand")),
        (("map", "{table}", "press"), ("no machine 'press'",)),
        (("info", "{table}"), ("{table}", "--map")),
        (("info", "{bag}", "--map", "{table}"), ("{table}", "not UTF-8")),
    ],
)  # fmt: skip
def test_faults_are_told_in_one_line(
    words: tuple[str, ...], expected: tuple[str, ...], plant: Plant, tmp_path: Path
) -> None:
    paths = {"map": plant.map, "bag": plant.bag, "table": plant.table, "new": tmp_path / "new"}
    found = mech_twin(*(word.format(**paths) for word in words))
    assert found.code == 2
    assert found.err.startswith("mech-twin: ")
    assert found.err.count("\n") == 1
    for word in expected:
        assert word.format(**paths) in found.err


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"joint": "sub_shaft"}, ("no joint 'sub_shaft'", "main_shaft")),
        ({"topic": "/plant/whel"}, ("no topic '/plant/whel'", "did you mean '/plant/wheel'")),
        ({"topic": "/other/wheel"}, ()),  # matched without the namespace
        ({"field": "velocity"}, ("no velocity",)),
        ({"field": "angle"}, ("'angle'", "position, velocity or effort")),
    ],
)  # fmt: skip
def test_what_a_bag_does_not_hold_is_named(
    change: dict[str, str], expected: tuple[str, ...], plant: Plant, tmp_path: Path
) -> None:
    first = SENSORS["channels"][0]
    tree = {**SENSORS, "channels": [{**first, "source": {**first["source"], **change}}, *SENSORS["channels"][1:]]}
    found = mech_twin("info", plant.bag, "--map", written(tmp_path / "map.yaml", tree))
    assert found.code == (2 if expected else 0), found.err
    assert all(word in found.err for word in expected)


def test_a_wrong_map_is_contradicted_by_the_run(plant: Plant, tmp_path: Path) -> None:
    wrong = [dict(channel) for channel in SENSORS["channels"]]
    wrong[1]["unit"] = "m"
    found = mech_twin("info", plant.table, "--map", written(tmp_path / "map.yaml", {**SENSORS, "channels": wrong}))
    assert found.code == 1
    assert "is its unit mm?" in found.err


def test_a_file_that_is_no_measurement_is_told_what_one_is(plant: Plant, tmp_path: Path) -> None:
    workbook = tmp_path / "plant.xlsx"
    workbook.write_bytes(b"PK\x03\x04" + bytes(100))
    for words in (("map", workbook, SENSORS["machine"]), ("info", workbook, "--map", plant.map)):
        refused = mech_twin(*words)
        assert refused.code == 2
        assert "nor a table of text or Parquet" in refused.err


@pytest.mark.parametrize("verb", ["info", "map"])
def test_a_run_too_long_to_be_compared_with_the_model_says_so(
    verb: str, plant: Plant, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measured, "MOST_SAMPLES", 100)
    words = ("info", plant.table, "--map", plant.map) if verb == "info" else ("map", plant.table, SENSORS["machine"])
    found = mech_twin(*words)
    assert found.code == 0
    assert "not compared with the model" in found.err


def test_a_measured_run_is_analysed_and_shown(plant: Plant, tmp_path: Path) -> None:
    unknown = [dict(channel) for channel in SENSORS["channels"]]
    unknown[0]["zero"] = "per_run"
    given = written(tmp_path / "map.yaml", {**SENSORS, "channels": unknown})
    found = mech_twin("replay", plant.table, "--analyse", "--map", given, "--json")
    assert found.code == 0, found.err
    document = json.loads(found.out)
    assert document["samples"] == 401
    assert document["crank_zero_rad"] == pytest.approx(np.radians(33.0), abs=0.005)
    shares = {each["name"]: each["share"] for each in document["compared"]}
    assert shares[SLIDER] < 0.01
    assert shares["forces.shaking_force_y_n"] < 0.1
    beyond = mech_twin("replay", plant.bag, "--analyse", "--map", given, "--tolerance", "1e-4", "--json")
    assert beyond.code == 1
    assert "expected at most 0.0001" in beyond.err


def test_a_channel_that_the_motion_does_not_tell_is_named(plant: Plant, tmp_path: Path) -> None:
    channels = [*SENSORS["channels"][:2], {**SENSORS["channels"][2], "is": "motor.motor.effort"}]
    given = written(tmp_path / "map.yaml", {**SENSORS, "channels": channels})
    found = mech_twin("replay", plant.table, "--analyse", "--map", given, "--json")
    assert found.code == 0, found.err
    assert [each["name"] for each in json.loads(found.out)["compared"]] == [SLIDER]
    assert "not compared: motor.motor.effort;" in found.err


def test_a_measured_run_is_drawn_by_the_mechanism(plant: Plant, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    file = tmp_path / "run.rrd"
    found = mech_twin("view", plant.table, "--map", plant.map, "--save", file)
    assert found.code == 0, found.err
    assert file.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("replay", "{table}", "--map", "{map}"), ("--analyse",)),
        (("replay", "{bag}", "--tolerance", "0.1"), ("--tolerance goes with --analyse",)),
        (("replay", "{table}", "--analyse", "--map", "{nowhere}"), ("cannot be read",)),
    ],
)  # fmt: skip
def test_a_map_where_it_has_no_use_is_refused(words: tuple[str, ...], expected: tuple[str, ...], plant: Plant) -> None:
    paths = {"map": plant.map, "bag": plant.bag, "table": plant.table, "nowhere": plant.map.parent / "nowhere.yaml"}
    found = mech_twin(*(word.format(**paths) for word in words))
    assert found.code == 2
    assert all(word in found.err for word in expected)
    assert found.err.count("\n") == 1


def test_the_runs_of_a_map_are_read_where_the_command_line_names_none(plant: Plant, tmp_path: Path) -> None:
    named = written(tmp_path / "named.yaml", {**SENSORS, "runs": [str(plant.table)]})
    words = ("identify", "vibration_crank", "--free", "crank_m", "--motion", "measured", "--json")
    given, of_map = mech_twin(*words, plant.table, "--map", plant.map), mech_twin(*words, "--map", named)
    assert given.code == of_map.code == 0, of_map.err
    one, other = json.loads(of_map.out), json.loads(given.out)
    assert {**one, "seconds": 0.0} == {**other, "seconds": 0.0}
    for verb in ("identify", "monitor"):
        none = mech_twin(verb, "vibration_crank", "--map", plant.map)
        assert none.code == 2
        assert "expected at least one run" in none.err
