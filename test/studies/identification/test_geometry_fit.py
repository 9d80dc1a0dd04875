# SPDX-License-Identifier: Apache-2.0
"""Lengths found from positions are those of the machine that was measured, and what cannot be seen is not claimed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from command_line import Ended, mech_twin

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.parameters.load import configuration_file, machine_parameters
from mech_twin.studies.identification.geometry_fit import GeometryFit, GeometryModel, half_width, unseen

pytest.importorskip("pyarrow")
pytestmark = pytest.mark.slow
TRUE = {"crank_m": 0.131, "rod_m": 0.47, "offset_m": 0.02}
SPEEDS_RPM, ZEROS_DEG = (110.0, 150.0, 190.0), (20.0, -75.0, 140.0)
MACHINE = "vibration_crank"


def sensors(zero_deg: float, **slide: Any) -> dict[str, Any]:
    wheel = {"source": {"column": "Wheel (deg)"}, "is": "linkage.crank.position", "unit": "deg", "zero": zero_deg}
    piston = {"source": {"column": "Slide (mm)"}, "is": "linkage.slider.position", "unit": "mm", "zero": 45.0, **slide}
    return {
        "machine": MACHINE,
        "time": {"column": "time_s"},
        "channels": [
            {**wheel, "rate_hz": 200.0, "quantum": 0.1},
            {**piston, "rate_hz": 120.0, "sigma": 0.3, "drop": 0.03},
        ],
    }


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a directory with three runs of a machine with other lengths, and their map."""
    folder = tmp_path_factory.mktemp("stand")
    lengths = [word for key, value in TRUE.items() for word in ("--set", f"{key}={value}")]
    for i, (speed, zero) in enumerate(zip(SPEEDS_RPM, ZEROS_DEG, strict=True)):
        file = folder / f"sensors_{i}.yaml"
        file.write_text(yaml.safe_dump(sensors(zero)), encoding="utf-8")
        words = (
            "--sensors",
            file,
            "--table",
            folder / f"run_{i}.csv",
            "--seed",
            str(i),
            "--set",
            f"drive.speed_rpm={speed}",
        )
        ended = mech_twin("simulate", MACHINE, "--duration", "3", "--one-step", *words, *lengths, "--json")
        assert ended.code == 0, ended.err
    tree = sensors(0.0)
    tree["channels"][0]["zero"], tree["channels"][1]["zero"] = "per_run", "free"
    (folder / "map.yaml").write_text(yaml.safe_dump(tree), encoding="utf-8")
    return folder


def identified(stand: Path, *words: str | Path) -> Ended:
    runs = [stand / f"run_{i}.csv" for i in range(3)]
    return mech_twin("identify", MACHINE, *runs, "--map", stand / "map.yaml", *words)


def test_lengths_and_assembly_are_found_where_nothing_is_named(stand: Path, tmp_path: Path) -> None:
    other, out = tmp_path / "other.yaml", tmp_path / "found.yaml"
    other.write_text(configuration_file(MACHINE).read_text(encoding="utf-8").replace("slider: above", "slider: below"))
    ended = identified(stand, "--config", other, "--out", out, "--json")
    assert ended.code == 0, ended.err
    document = json.loads(ended.out)
    assert document["assembly"]["configured"] == {"slider": "above"}
    assert document["assembly"]["margin"] > 2.0
    found = {each["key"]: each for each in document["parameters"]}
    assert set(found) == set(TRUE)
    for key, true in TRUE.items():  # a crank that turns the other way has its line on the other side
        ends = (found[key]["low_95"], found[key]["high_95"])
        low, high = sorted(map(abs, ends)) if key == "offset_m" else ends
        assert low <= true <= high
    assert "slider: above" in out.read_text(encoding="utf-8")


def test_the_lengths_of_the_machine_are_found_within_their_intervals(stand: Path, tmp_path: Path) -> None:
    out = tmp_path / "found.yaml"
    free = [word for key in (*TRUE, "masses.tree_kg") for word in ("--free", key)]
    ended = identified(stand, *free, "--out", out, "--json")
    assert ended.code == 0, ended.err
    document = json.loads(ended.out)
    found = {each["key"]: each for each in document["parameters"]}
    for key, true in TRUE.items():
        assert found[key]["verdict"] == "identified"
        assert found[key]["low_95"] <= true <= found[key]["high_95"]
        assert abs(found[key]["estimate"] - true) < 0.004
    assert found["masses.tree_kg"]["verdict"] == "not_excited"
    (score,) = document["held_out"]["scores"]
    assert document["held_out"]["run"].endswith("run_2.csv")
    assert score["fit_percent"] > 99.0 > score["before_percent"]
    written = machine_parameters(MACHINE, out).model_dump()
    assert written["crank_m"] == pytest.approx(found["crank_m"]["estimate"], rel=1e-12)
    assert written["masses"]["tree_kg"] == 50.0
    assert "# masses.tree_kg: kept, not_excited" in out.read_text(encoding="utf-8")


def test_lengths_that_are_not_found_under_a_wrong_unit_or_a_set_clock_say_which(stand: Path, tmp_path: Path) -> None:
    wrong, late = tmp_path / "wrong.yaml", tmp_path / "late.csv"
    wrong.write_text((stand / "map.yaml").read_text(encoding="utf-8").replace("unit: mm", "unit: m"), encoding="utf-8")
    head, *rows = (stand / "run_0.csv").read_text(encoding="utf-8").splitlines()
    cells = [row.split(",", 1) for row in rows]
    shifted = [f"{float(at) + 5.0 * (float(at) > 1.5)!r},{rest}" for at, rest in cells]
    late.write_text("\n".join([head, *shifted]), encoding="utf-8")
    ended = mech_twin("identify", MACHINE, stand / "run_0.csv", "--map", wrong, "--free", "rod_m")
    assert ended.code == 1
    assert "is its unit mm" in " ".join(ended.err.split())
    ended = mech_twin("identify", MACHINE, late, "--map", stand / "map.yaml", "--free", "rod_m")
    assert "has the clock been set forward?" in " ".join(ended.err.split())


def test_nothing_identified_writes_nothing_and_ends_with_1(stand: Path, tmp_path: Path) -> None:
    out = tmp_path / "found.yaml"
    ended = identified(stand, "--free", "masses.tree_kg", "--out", out)
    assert ended.code == 1
    assert "no key is identified" in ended.err
    assert not out.exists()


def test_another_assembly_is_a_model_error_and_not_identified(stand: Path) -> None:
    ended = identified(stand, "--free", "crank_m", "--set", "rod_m=0.2", "--set", "crank_m=0.1", "--json")
    (key,) = json.loads(ended.out)["parameters"]
    assert key["verdict"] == "model_error"


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--free", "crank_mm"), ("--free crank_mm", "a number")),
        (("--free", "slider"), ("--free slider", "a number")),
        (("--free", "crank_m=0.1:0.2"), ("--free crank_m=0.1:0.2: not used", "--motion simulated")),
        (("--free", "crank_m", "--hold-out", "other.csv"), ("--hold-out other.csv", "at least two runs")),
    ],
)
def test_what_cannot_be_asked_is_told_in_one_line(
    words: tuple[str, ...], expected: tuple[str, ...], stand: Path
) -> None:
    ended = identified(stand, *words)
    assert ended.code == 2
    assert ended.err.count("\n") == 1
    assert all(word in ended.err for word in expected)


def test_keys_that_act_together_are_found_by_the_direction_that_is_not_seen() -> None:
    random = np.random.default_rng(2)
    one, other = random.standard_normal((2, 50))
    jacobian = np.stack([one, -3.0 * one, other, np.zeros(50)], axis=1)
    fit = GeometryFit(np.ones(3), np.zeros(0), np.zeros(1), (), jacobian, 0.0, np.ones(1))
    assert unseen(fit, 3) == pytest.approx([0.5**0.5, 0.5**0.5, 0.0], abs=1e-9)
    assert unseen(fit, 4)[3] == 1.0


def test_the_interval_of_few_runs_is_wider() -> None:
    assert half_width(np.array([1.0]), 2) == pytest.approx([12.706], rel=1e-4)  # Student's table
    assert half_width(np.array([1.0]), 3) == pytest.approx([4.303], rel=1e-3)
    assert half_width(np.array([1.0]), 1) == pytest.approx([1.960], rel=1e-3)


def test_positions_by_the_spline_are_those_of_the_mechanism() -> None:
    parameters = machine_parameters(MACHINE)
    model = GeometryModel(MACHINE, parameters, ("crank_m",), columns=("linkage.slider.position",))
    curve = model.positions([0.11])["linkage.slider.position"]
    angle = np.linspace(-9.0, 9.0, 500)
    exact = 0.11 * np.sin(angle) + np.sqrt(0.504**2 - (0.11 * np.cos(angle)) ** 2)
    also = 0.11 * np.cos(angle) + np.sqrt(0.504**2 - (0.11 * np.sin(angle)) ** 2)
    off = min(np.abs(curve(angle) - each).max() for each in (exact, also))
    assert off < 1e-8


def test_a_machine_whose_joints_do_not_follow_its_crank_is_refused() -> None:
    model = GeometryModel("roller_former", machine_parameters("roller_former"), (), columns=("linkage.crank.position",))
    with pytest.raises(ConfigurationError, match="follow from its crank"):
        model.positions([])
