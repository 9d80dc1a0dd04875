# SPDX-License-Identifier: Apache-2.0
"""`mech-twin monitor`: a recorded run judged, a sensor set judged, and what is wrong told in one line."""

from __future__ import annotations

import json
from pathlib import Path
from shutil import copyfile, copytree
from typing import Any

import pytest
import yaml
from command_line import mech_twin

from mech_twin.cli.monitor import show_design

pytest.importorskip("pyarrow")
pytestmark = [pytest.mark.usefixtures("ros_domain"), pytest.mark.slow]
CHANNELS: list[dict[str, Any]] = [
    {"source": {"topic": "/plant/generator", "joint": "generator", "field": "effort"}, "is": "motor.generator.effort"},
    {"source": {"topic": "/plant/mass", "joint": "mass", "field": "position"}, "is": "linkage.mass.position"},
]
SIGMAS = (20.0, 0.001)
SENSORS = {
    "machine": "impact_mass",
    "channels": [
        {**channel, "rate_hz": 1000.0, "jitter_s": 2e-4, "sigma": s}
        for channel, s in zip(CHANNELS, SIGMAS, strict=True)
    ],
}
OFF_BEAT = "coupling.step_s=0.00093"  # no part of the period: rounding would decide in which step the force switches
OTHER = Path(__file__).resolve().parents[2] / "bags" / "mb10_breaker"
HEALTHY, FAULTY, CHANGE_S = 16.0, 14.0, 10.0


class Plant:
    """Sensors of an impact mass, a healthy run of it and one whose force level drops."""

    def __init__(self, folder: Path) -> None:
        self.map, self.healthy, self.faulty = folder / "map.yaml", folder / "healthy", folder / "faulty.csv"
        self.map.write_text(yaml.safe_dump(SENSORS, sort_keys=False), encoding="utf-8")


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> Plant:
    found = Plant(tmp_path_factory.mktemp("plant"))
    words = ("simulate", "impact_mass", "--set", OFF_BEAT, "--sensors", found.map, "--one-step", "--json")
    runs = [
        (*words, "--duration", HEALTHY, "--bag", found.healthy),
        (*words, "--duration", FAULTY, "--table", found.faulty, "--change", f"phase1_force_n=-10%@{CHANGE_S}"),
    ]
    for run in runs:
        assert not mech_twin(*run).code
    return found


def test_a_fault_in_a_run_is_found_named_and_sized(plant: Plant, tmp_path: Path) -> None:
    kept = tmp_path / "healthy.json"
    words = ("monitor", "impact_mass", plant.faulty, "--map", plant.map, "--arl0", 1.0)
    code, out, _ = mech_twin(*words, "--baseline", plant.healthy, "--save-baseline", kept, "--json")
    record = json.loads(out)
    assert code == 1
    assert record["arl0_h"] == pytest.approx(1.0) and record["extrapolated"] and record["baseline"]["cycles"] > 200
    assert {"name": "force_mean_n", "unit": "N"}.items() <= record["features"][0].items()
    (alarm,) = record["runs"][0]["alarms"]
    assert CHANGE_S - 0.1 <= alarm["onset_s"] <= CHANGE_S + 0.1 <= alarm["alarm_s"] + 0.1 <= CHANGE_S + 0.5
    assert alarm["finding"] == "first_level"
    (named,) = alarm["candidates"]
    assert named["low_95"] <= -0.1 <= named["high_95"] and named["high_95"] - named["low_95"] < 0.02
    again = mech_twin(*words, "--baseline", kept, "--json")
    assert json.loads(again[1])["runs"] == record["runs"]
    shadow = ("shadow", "impact_mass", "--from", "plant", "--monitor", kept)  # the same check, before it listens
    heavier = mech_twin(*shadow, "--map", plant.map, "--set", "restitution=0.4")
    assert heavier[0] == 2 and "healthy.json: made with another configuration" in heavier[2]
    unmapped = mech_twin(*shadow)
    assert unmapped[0] == 2 and "healthy.json: made with another map" in unmapped[2]
    other = mech_twin(*words[:-1], 8.0, "--baseline", kept)
    assert other[0] == 2 and "--arl0 8: " in other[2] and "holds thresholds for 1 h" in other[2]
    shown = mech_twin(*words, "--baseline", kept)
    assert shown[0] == 1 and "first_level" in shown[1] and "extrapolated" in shown[2]
    picture = tmp_path / "why.svg"
    asked = (*words, "--baseline", kept, "--explain", "first_level", "--picture", picture)
    why = json.loads(mech_twin(*asked, "--json")[1])["runs"][0]["explained"][0]
    assert why["explains"] and why["fault"] == named and why["finding"] == "first_level"
    force = next(each for each in why["features"] if each["name"] == "force_mean_n")
    assert abs(force["change"] - force["expected"]) <= abs(0.1 * force["change"]) and force["unit"] == "N"
    moved = [abs(each["moved_sigma"]) for each in why["features"]]
    assert moved == sorted(moved, reverse=True)
    drawn = picture.read_text(encoding="utf-8")
    assert why["features"][0]["name"] in drawn and "first_level of" in drawn
    refused = mech_twin(*words, "--baseline", kept, "--explain", "gone")
    assert refused[0] == 2 and "fault 'gone': expected one of " in refused[2] and "first_level" in refused[2]


def test_a_kept_baseline_of_a_page_judges_again_wherever_the_page_lies(tmp_path: Path) -> None:
    """A baseline is of the numbers on a page, not of its path; the shadow of a page knows no path."""
    page, map_file, table, kept = (tmp_path / name for name in ("own.yaml", "map.yaml", "run.csv", "kept.json"))
    page.write_text(mech_twin("new", "slider_crank").out, encoding="utf-8")
    sensor = {"source": {"topic": "sensors", "joint": "motor", "field": "effort"}, "is": "motor.motor.effort"}
    crank = {"source": {"topic": "sensors", "joint": "crank", "field": "position"}}
    crank["is"] = f"linkage.{next(iter(yaml.safe_load(page.read_text(encoding='utf-8'))['joints']))}.position"
    channels = [{**crank, "sigma": 0.001, "rate_hz": 500.0}, {**sensor, "sigma": 0.3, "rate_hz": 500.0}]
    map_file.write_text(yaml.safe_dump({"machine": "page", "channels": channels}), encoding="utf-8")
    assert not mech_twin("simulate", page, "--duration", 20, "--sensors", map_file, "--table", table, "--json").code
    words = (table, "--map", map_file, "--baseline")
    first = mech_twin("monitor", page, *words, table, "--arl0", 1.0, "--save-baseline", kept, "--json")
    moved = copyfile(page, tmp_path / "moved.yaml")
    again = mech_twin("monitor", moved, *words, kept, "--json")
    assert first.code == again.code == 0, again.err
    assert json.loads(again.out)["runs"] == json.loads(first.out)["runs"]
    unmapped = mech_twin("shadow", page, "--from", "plant", "--monitor", kept)  # refused later than another machine's
    assert unmapped.code == 2 and "kept.json: made with another map" in unmapped.err


def test_a_fleet_is_ranked_each_machine_by_its_own_baseline_and_its_sisters(
    plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hall, page, first = tmp_path / "hall", tmp_path / "fleet.html", tmp_path / "hall" / "m0"
    words = ("fleet", "impact_mass", hall, "--map", plant.map, "--set", OFF_BEAT, "--arl0", 1.0, "--cores", 1)
    assert "hall: cannot be listed" in mech_twin(*words)[2]
    first.mkdir(parents=True)
    copytree(plant.healthy, first / "a")
    copyfile(plant.faulty, first / "b.csv")
    foreign = mech_twin("fleet", "winding_drum", hall, "--map", plant.map)  # before any machine is judged
    assert foreign[0] == 2 and "value 'impact_mass': expected 'winding_drum'" in foreign[2]
    assert "not judged" not in foreign[1] + foreign[2]
    monkeypatch.setattr("mech_twin.studies.spreading.CONNECT_S", 1.0)
    away = mech_twin(*words[:-2], "--save-baselines", "--scheduler", "tcp://127.0.0.1:9")
    assert away[0] == 2 and "no connection" in away[2] and not (first / "baseline.json").exists()
    code, _, err = mech_twin(*words, "--save-baselines")
    assert code == 1 and (first / "baseline.json").exists() and "too few sisters" in err
    for name in ("m1", "m2", "m3", "m4", "m5"):
        copytree(plant.healthy, hall / name / "a")
        copyfile(first / "baseline.json", hall / name / "baseline.json")
    (hall / "m6").mkdir()
    for name, kept in (("m7", first / "baseline.json"), ("m8", plant.map)):  # of another machine
        copytree(OTHER, hall / name / "a")
        copyfile(kept, hall / name / "baseline.json")
    copytree(plant.healthy, hall / "n0")  # not in the folder of its machine
    (hall / "m9" / "a").mkdir(parents=True)
    copyfile(first / "baseline.json", hall / "m9" / "baseline.json")
    (hall / "m9" / "a" / "a_0.mcap").write_bytes(b"broken")
    code, out, _ = mech_twin(*words, "--json", "--page", page)
    told = json.loads(out)
    assert code == 1 and told["machines"][0]["name"] == "m0"
    assert told["machines"][0]["finding"] == "first_level" and told["machines"][0]["recording"] == "b.csv"
    assert told["machines"][0]["candidate"]["low_95"] <= -0.1 <= told["machines"][0]["candidate"]["high_95"]
    assert told["machines"][0]["onset_s"] == pytest.approx(CHANGE_S, abs=0.1)
    assert told["machines"][0]["verdict"] == "confirmed" and told["limit"] > told["confirming"] > 0.0
    assert not any(each["verdict"] for each in told["machines"][1:])
    assert "0 recordings; expected baseline.json and a recording" in told["refused"]["m6"]
    assert "has no topic '/plant/generator'" in told["refused"]["m7"] and {"m8", "m9"} < set(told["refused"])
    assert "n0: a bag; expected the folder of a machine" in told["refused"]["n0"]
    drawn = page.read_text(encoding="utf-8")
    assert "first_level" in drawn and "Not judged" in drawn
    assert f"with 6 machines a finding is confirmed beyond {told['confirming']:.3g}, a machine without one" in drawn
    other = mech_twin(*words[:5], "--set", "restitution=0.4", "--json")
    assert other[0] == 2 and "made with another configuration" in json.loads(other[1])["refused"]["m1"]


def test_a_healthy_run_has_no_alarm_and_exit_code_0(plant: Plant) -> None:
    code, _, err = mech_twin("monitor", "impact_mass", plant.healthy, "--map", plant.map)
    assert code == 0
    assert "cycles are taken as healthy" in err and "no alarm" in err


def test_a_sensor_fault_without_an_alarm_is_told_beside_the_cycles_that_were_not_judged(
    plant: Plant, tmp_path: Path
) -> None:
    run, stuck = tmp_path / "run.csv", tmp_path / "stuck.csv"
    words = ("simulate", "impact_mass", "--set", OFF_BEAT, "--sensors", plant.map, "--one-step", "--json")
    mech_twin(*words, "--duration", 8.0, "--table", run)
    head, *rows = [line.split(",") for line in run.read_text(encoding="utf-8").splitlines()]
    place = next(i for i, name in enumerate(head) if "mass" in name)
    value = next(row[place] for row in rows if row[place])
    for row in rows:
        if float(row[0]) > 5.0 and row[place]:
            row[place] = value
    stuck.write_text("\n".join(",".join(row) for row in [head, *rows]), encoding="utf-8")
    given = ("--map", plant.map, "--baseline", plant.healthy, "--arl0", 1.0)
    code, _, err = mech_twin("monitor", "impact_mass", stuck, *given)
    assert code == 1
    (told,) = [line for line in err.splitlines() if "cycles," in line and line.startswith(str(stuck))]
    assert told.endswith("fault: sensor_stuck:linkage.mass.position")
    assert " not judged" in told and "no alarm" not in told


def test_a_run_of_which_no_cycle_can_be_judged_is_not_called_healthy(plant: Plant, tmp_path: Path) -> None:
    run = tmp_path / "short.csv"
    words = ("simulate", "impact_mass", "--set", OFF_BEAT, "--sensors", plant.map, "--one-step", "--json")
    mech_twin(*words, "--duration", 3.0, "--table", run)
    head, *rows = [line.split(",") for line in run.read_text(encoding="utf-8").splitlines()]
    beside = next(i for i, name in enumerate(head) if "generator" in name)
    kept = [row for row in rows if row[beside] or float(row[0]) % 0.05 > 0.0065]  # a gap of the mass in each cycle
    run.write_text("\n".join(",".join(row) for row in [head, *kept]), encoding="utf-8")
    code, _, err = mech_twin("monitor", "impact_mass", run, "--map", plant.map, "--baseline", plant.healthy)
    assert code == 2
    assert "0 cycles, 19 of 19 not judged (position_mean_m," in err and "expected what the baseline has" in err


def test_a_run_without_a_cycle_says_what_its_reference_does(tmp_path: Path) -> None:
    source = {"column": "crank", "topic": "/crank", "joint": "crank", "field": "position"}
    channels = [{"source": source, "is": "linkage.crank.position", "sign": -1, "rate_hz": 200.0}]
    for name, sign in (("backward", 1), ("forward", -1)):
        tree = {"machine": "vibration_crank", "channels": [{**channels[0], "sign": sign}]}
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(tree), encoding="utf-8")
    run = tmp_path / "run.csv"
    seen = ("--sensors", tmp_path / "forward.yaml", "--one-step", "--json")
    words = ("simulate", "vibration_crank", "--duration", "4", *seen)
    mech_twin(*words, "--table", run)
    code, _, err = mech_twin("monitor", "vibration_crank", run, "--map", tmp_path / "backward.yaml")
    assert code == 2
    assert "rad; expected it to rise by more than a turn (sign: -1 in the map?)" in err


def test_days_join_and_a_baseline_is_renewed_with_a_yes_alone(plant: Plant, tmp_path: Path) -> None:
    second, third, kept = tmp_path / "second", tmp_path / "third", tmp_path / "healthy.json"
    for day in (second, third):
        copytree(plant.healthy, day)
    words = ("monitor", "impact_mass", second, "--map", plant.map, "--arl0", 1.0, "--set", OFF_BEAT)
    days = ("--baseline", plant.healthy, "--baseline", second)
    mech_twin(*words, *days, "--save-baseline", kept)
    before = json.loads(kept.read_text(encoding="utf-8"))
    cycles = [run["cycles"] for run in before["origin"]["runs"]]
    assert len(cycles) == 2 and before["baseline"]["cycles"] == sum(cycles)
    renew = ("monitor", "impact_mass", third, *words[3:], "--baseline", kept, "--renew")
    code, _, err = mech_twin(*renew)  # nobody is at the terminal
    assert code == 0 and "not renewed" in err and json.loads(kept.read_text(encoding="utf-8")) == before
    other = mech_twin(*renew[:-3], "--set", "restitution=0.4", *renew[-3:])
    assert other[0] == 2 and "made with another configuration" in other[2]
    faulty = ("monitor", "impact_mass", plant.faulty, *renew[3:], "--yes")
    code, _, err = mech_twin(*faulty)
    assert code == 1 and "not renewed, a run has an alarm" in err
    assert json.loads(kept.read_text(encoding="utf-8")) == before
    old = before | {"origin": before["origin"] | {"made_utc": "2020-01-31T12:00:00+00:00"}}
    kept.write_text(json.dumps(old), encoding="utf-8")
    code, _, err = mech_twin(*renew, "--yes")
    after = json.loads(kept.read_text(encoding="utf-8"))
    assert code == 0 and "days old, older than 90" in err and "renewed with 1 more, 3 runs" in err
    assert after["baseline"]["cycles"] == sum(cycles) + cycles[0] and after["origin"]["made_utc"] > "2026"
    again = mech_twin(*renew, "--yes")
    assert again[0] == 2 and "is in" in again[2] and "expected another day" in again[2]


def test_a_run_under_the_twins_own_names_needs_no_map(tmp_path: Path) -> None:
    bag = tmp_path / "own"
    words = ("--set", OFF_BEAT, "--duration", 9, "--bag", bag, "--change", "restitution=0.4@8")
    mech_twin("simulate", "impact_mass", *words)
    code, out, _ = mech_twin("monitor", "impact_mass", bag, "--skip", 1.5, "--json")
    record = json.loads(out)
    assert code == 1
    assert {"impact_share", "speed_ratio"} <= {feature["name"] for feature in record["features"]}
    (alarm,) = record["runs"][0]["alarms"]
    assert alarm["onset_s"] == pytest.approx(8.0, abs=0.11)


def test_a_run_of_another_machine_is_refused_without_a_map() -> None:
    code, _, said = mech_twin("monitor", "vibration_crank", OTHER)
    assert (code, said) == (
        2,
        f"mech-twin: {OTHER}: a run of mb10_breaker; expected one of vibration_crank, or --map FILE\n",
    )


def test_a_sensor_set_is_judged_before_it_is_bought(
    plant: Plant, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    judged: list[tuple[Any, ...]] = []

    def kept(*found: Any, as_json: bool) -> None:
        judged.append(found)
        show_design(*found, as_json=as_json)

    monkeypatch.setattr("mech_twin.cli.monitor.show_design", kept)
    words = ("monitor", "impact_mass", "--design", "--sensors", plant.map)
    code, out, _ = mech_twin(*words, "--json")
    record = json.loads(out)
    assert code == 0
    faults = {fault["name"]: fault for fault in record["faults"]}
    assert {"restitution", "first_level", "second_level", "stop_moved"} <= set(faults)
    assert all(record["isolability"][name][name] == pytest.approx(0.0, abs=1e-9) for name in faults)
    assert "sensor_bias:linkage.mass.position" in faults["stop_moved"]["alike"]  # a moved stop moves the whole motion
    assert 1.0 <= faults["first_level"]["delay_cycles"] <= 5.0
    show_design(*judged[0], as_json=False)  # what is judged takes long, and is told in either form
    assert "looks like" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ((), "expected at least one run, or --design --sensors FILE"),
        (("--design",), "--design goes with --sensors"),
        (("FAULTY", "--sensors", "MAP"), "--sensors goes with --design: a run has --map"),
        (("FAULTY", "--map", "MAP", "--baseline", "gone.json"), "gone.json: cannot be read"),
        (("FAULTY", "--map", "MAP", "--picture", "why.svg"), "--picture"),
        (("FAULTY", "--map", "MAP", "--baseline", "FAULTY", "--renew"), "--renew: expected --baseline FILE.json"),
        (("FAULTY", "--map", "MAP", "--baseline", "a.json", "--baseline", "FAULTY"), "a.json: expected it alone"),
        (
            ("FAULTY", "--map", "MAP", "--skip", "100"),
            "no complete cycle of motor.generator.effort after 100 s: the run is shorter; expected a shorter --skip",
        ),
        (("FAULTY", "--map", "MAP", "--skip", "12"), "the baseline holds "),
    ],
)
def test_what_is_wrong_is_told_in_one_line(words: tuple[str, ...], told: str, plant: Plant) -> None:
    places = {"FAULTY": plant.faulty, "MAP": plant.map}
    code, _, err = mech_twin("monitor", "impact_mass", *(places.get(word, word) for word in words))
    assert code not in (0, 1) and told in err and "Traceback" not in err
    assert err.strip().splitlines()[-1].count(told) == 1


def test_a_second_sensor_of_one_quantity_is_named_as_left_out(plant: Plant, tmp_path: Path) -> None:
    again = {**CHANNELS[1], "source": {"topic": "/plant/again", "joint": "mass", "field": "position"}}
    given = tmp_path / "two.yaml"
    given.write_text(yaml.safe_dump({**SENSORS, "channels": [*SENSORS["channels"], again]}), encoding="utf-8")
    code, _, err = mech_twin("monitor", "impact_mass", "--design", "--sensors", given)
    assert code == 0
    assert "/plant/again mass position: left out, linkage.mass.position is read from /plant/mass mass position" in err


def test_a_sensor_that_no_feature_reads_is_named_as_left_out(plant: Plant, tmp_path: Path) -> None:
    other = {"source": {"topic": "/plant/work", "field": "data"}, "is": "forces.drive_work_j"}
    given = tmp_path / "work.yaml"
    given.write_text(yaml.safe_dump({**SENSORS, "channels": [*SENSORS["channels"], other]}), encoding="utf-8")
    said = "left out, no feature of a cycle reads"
    code, _, err = mech_twin("monitor", "impact_mass", "--design", "--sensors", given)
    assert (code, err.count(said)) == (0, 1)
    assert f"/plant/work data: {said} forces.drive_work_j" in err


def test_a_map_of_another_machine_is_refused(plant: Plant) -> None:
    code, _, err = mech_twin("monitor", "winding_drum", plant.faulty, "--map", plant.map)
    assert code not in (0, 1) and "key 'machine', value 'impact_mass': expected 'winding_drum'" in err
