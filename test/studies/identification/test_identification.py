# SPDX-License-Identifier: Apache-2.0
"""Keys found by fitting the model's motion are those of the machine that was measured, within their intervals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import mech_twin

from mech_twin.parameters.load import machine_parameters

pytest.importorskip("pyarrow")
pytestmark = pytest.mark.slow
MACHINE = "vibration_crank"
TRUE = {"crank_m": 0.131, "rod_m": 0.47, "masses.tree_kg": 58.0, "working_force_n": 120.0}
UNSEEN = ("masses.stand_kg", "counterweight.density_kg_per_m3")
SENSORS: list[dict[str, Any]] = [
    {"source": {"column": "wheel"}, "is": "linkage.crank.position", "zero": 0.3, "sigma": 0.002, "rate_hz": 200.0},
    {
        "source": {"column": "slide (mm)"},
        "is": "linkage.slider.position",
        "unit": "mm",
        "zero": 40.0,
        "lag_s": 0.004,
        "sigma": 0.3,
        "rate_hz": 150.0,
    },
    {"source": {"column": "torque"}, "is": "motor.motor.effort", "sigma": 2.0, "rate_hz": 200.0},
]


def map_of(channels: list[dict[str, Any]]) -> str:
    return yaml.safe_dump({"machine": MACHINE, "time": {"column": "t"}, "channels": channels})


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a directory with one run of another machine, and its map, which leaves zeros and the lag open."""
    folder = tmp_path_factory.mktemp("dynamic")
    (folder / "sensors.yaml").write_text(map_of(SENSORS), encoding="utf-8")
    opened = [{**channel, **({"zero": "free"} if "zero" in channel else {})} for channel in SENSORS]
    opened[1]["lag_s"] = "free"
    (folder / "map.yaml").write_text(map_of(opened), encoding="utf-8")
    settings = [word for key, value in TRUE.items() for word in ("--set", f"{key}={value}")]
    ended = mech_twin(
        *("simulate", MACHINE, "--duration", "2.4", "--one-step", "--sensors", folder / "sensors.yaml"),
        *("--table", folder / "plant.csv", "--seed", "5", "--json", *settings),
    )
    assert ended.code == 0, ended.err
    return folder


def free(*keys: str) -> list[str]:
    return [word for key in keys for word in ("--free", key)]


@pytest.fixture(scope="module")
def identified(stand: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a directory with what identification writes of that run."""
    out = tmp_path_factory.mktemp("identified")
    keys = free(*TRUE, *UNSEEN)
    ended = mech_twin("identify", MACHINE, stand / "plant.csv", "--map", stand / "map.yaml", *keys, "--out", out)
    assert ended.code == 0, ended.err
    return out


def test_keys_zeros_and_lag_are_found_and_what_is_not_seen_is_not_claimed(identified: Path) -> None:
    document = json.loads((identified / "identification.json").read_text(encoding="utf-8"))
    found = {each["key"]: each for each in document["parameters"]}
    for key in ("crank_m", "rod_m", "working_force_n"):
        assert found[key]["verdict"] == "identified"
        assert found[key]["low_95"] <= TRUE[key] <= found[key]["high_95"]
    assert abs(found["crank_m"]["estimate"] - TRUE["crank_m"]) < 2e-4
    # tree and stand swing together: their sum is seen, neither of them is
    assert {found[key]["verdict"] for key in ("masses.tree_kg", "masses.stand_kg")} == {"only_in_combination"}
    together = found["masses.tree_kg"]["estimate"] + found["masses.stand_kg"]["estimate"]
    assert together == pytest.approx(TRUE["masses.tree_kg"] + 50.5, rel=0.02)
    (told,) = (each for each in document["combinations"] if set(each["keys"]) == {"masses.tree_kg", "masses.stand_kg"})
    assert told["form"] == "sum"
    assert told["low_95"] <= TRUE["masses.tree_kg"] + 50.5 <= told["high_95"]
    assert told["high_95"] - told["low_95"] < 0.05 * told["estimate"]
    assert found["counterweight.density_kg_per_m3"]["verdict"] == "not_excited"
    slide = document["channels"][1]
    assert slide["zero"]["all"] == pytest.approx(40.0, abs=1.5)  # in the channel's own unit, mm
    assert slide["lag_s"]["all"] == pytest.approx(0.004, abs=2e-4)
    after, before = (
        document["held_out"]["fit_percent"]["linkage.slider.position"],
        document["held_out"]["before"]["fit_percent"]["linkage.slider.position"],
    )
    assert after > 99.5 > before
    written = machine_parameters(MACHINE, identified / f"{MACHINE}.yaml")
    assert written.crank_m == pytest.approx(found["crank_m"]["estimate"], rel=1e-12)  # type: ignore[attr-defined]
    text = (identified / f"{MACHINE}.yaml").read_text(encoding="utf-8")
    assert "# identified 0.13" in text
    assert "# kept: not_excited" in text


def test_nothing_is_written_where_no_key_is_identified(stand: Path, identified: Path, tmp_path: Path) -> None:
    known = identified / f"{MACHINE}.yaml"
    words = ("identify", MACHINE, stand / "plant.csv", "--map", stand / "map.yaml")
    out = tmp_path / "again.yaml"
    ended = mech_twin(*words, *free("counterweight.density_kg_per_m3"), "--config", known, "--out", out)
    assert ended.code == 1
    assert "no key is identified" in ended.err
    assert not out.exists()


def test_a_late_run_is_told_how_to_find_its_beginning(stand: Path, tmp_path: Path) -> None:
    head, *rows = (stand / "plant.csv").read_text(encoding="utf-8").splitlines()
    late = [(float(time) - 1.37, rest) for time, _, rest in (row.partition(",") for row in rows)]
    run = tmp_path / "late.csv"
    run.write_text("\n".join([head, *(f"{time},{rest}" for time, rest in late if time >= 0.0)]), encoding="utf-8")
    ended = mech_twin("identify", MACHINE, run, "--map", stand / "map.yaml", *free("crank_m"))
    assert ended.code == 1
    assert "--latest-begin" in ended.err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--free", "crank_m=0.2:0.3"), "expected bounds on either side of the configured 0.126"),
        (("--free", "crank_m=1"), "expected KEY=LOW:HIGH"),
        (("--free", "masses.tre_kg", "--motion", "simulated"), "expected a key of vibration_crank that is a number"),
        (("--prior", "crank_m=0.1"), "expected KEY=MEAN,SD"),
        (("--hold-out", "0.95"), "expected a run, or a share from 0 to 0.8"),
        (("--motion", "wild"), "expected 'auto', 'measured', 'simulated'"),
    ],
)
def test_what_cannot_be_asked_is_refused_in_one_line(stand: Path, words: tuple[str, ...], told: str) -> None:
    ended = mech_twin("identify", MACHINE, stand / "plant.csv", "--map", stand / "map.yaml", *words)
    assert ended.code == 2
    assert told in ended.err
    assert len(ended.err.strip().splitlines()) == 1
