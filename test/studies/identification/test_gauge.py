# SPDX-License-Identifier: Apache-2.0
"""A strain gauge on the tool tells the stiffness of wall and struck face, and a monitor what changed in them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from command_line import mech_twin

from mech_twin.capabilities.cycle import SampledCycle, sampled
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.rollout import roll_out
from mech_twin.errors import StudyError
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.sensors import SensorBench
from mech_twin.parameters.load import catalogue_entry, machine
from mech_twin.studies.monitoring.sensing import seen_run

MACHINE = "mb10_breaker"
KNOWN = {"tool.model": "wave", "tool.wave.wall.kind": "loading", "body.preload_deflection_m": 0.2}
WALL, FACE = "tool.wave.wall.stiffness_n_per_m", "tool.wave.face.stiffness_n_per_m"
TRUE = {WALL: 5.7e6, FACE: 1.7e8}
CHANNELS: list[dict[str, Any]] = [
    {"source": {"column": "crank"}, "is": "linkage.crank.position", "sigma": 1e-4, "rate_hz": 500.0},
    {"source": {"column": "strain"}, "is": "event.blow.peak_strain", "unit": "um/m", "sigma": 0.2},
    {"source": {"column": "back"}, "is": "event.blow.reflected_energy", "unit": "J", "sigma": 0.05},
    {"source": {"column": "forth"}, "is": "event.blow.forward_energy", "unit": "J", "sigma": 0.05},
]
MAP = {"machine": MACHINE, "time": {"column": "t"}, "channels": CHANNELS}


def settings(keys: dict[str, Any]) -> list[str]:
    return [word for key, value in keys.items() for word in ("--set", f"{key}={value}")]


@pytest.mark.slow
def test_stiffness_of_wall_and_face_are_found_from_a_gauge(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(MAP), encoding="utf-8")
    run = tmp_path / "run.csv"
    words = ("--duration", "1.2", "--sensors", tmp_path / "map.yaml", "--table", run, "--json")
    ended = mech_twin("simulate", MACHINE, "--one-step", *words, "--seed", "4", *settings(KNOWN | TRUE))
    assert ended.code == 0, ended.err
    words = ("--map", tmp_path / "map.yaml", "--free", WALL, "--free", FACE, "--out", tmp_path / "found")
    ended = mech_twin("identify", MACHINE, run, *words, *settings(KNOWN | {WALL: 5e6}))
    assert ended.code == 0, ended.err
    document = json.loads((tmp_path / "found" / "identification.json").read_text(encoding="utf-8"))
    for each in document["parameters"]:
        assert each["verdict"] == "identified"
        assert each["estimate"] == pytest.approx(TRUE[each["key"]], rel=1e-3)
        assert each["low_95"] <= TRUE[each["key"]] <= each["high_95"]


@pytest.mark.slow
def test_a_wall_is_found_from_blows_that_begin_late_in_the_run(tmp_path: Path) -> None:
    """As on the page `blow-into-wall`; no blow is in the first quarter, and an error of the wall soon grows large."""
    (tmp_path / "map.yaml").write_text(yaml.safe_dump(MAP), encoding="utf-8")
    run = tmp_path / "run.csv"
    words = ("--duration", "1.5", "--sensors", tmp_path / "map.yaml", "--table", run, "--json")
    ended = mech_twin("simulate", MACHINE, "--one-step", *words, *settings(KNOWN | {WALL: TRUE[WALL]}))
    assert ended.code == 0, ended.err
    words = ("--map", tmp_path / "map.yaml", "--free", WALL, "--out", tmp_path / "found")
    ended = mech_twin("identify", MACHINE, run, *words, *settings(KNOWN | {WALL: 5e6}))
    assert ended.code == 0, ended.err
    (wall,) = json.loads((tmp_path / "found" / "identification.json").read_text(encoding="utf-8"))["parameters"]
    assert wall["verdict"] == "identified"
    assert wall["low_95"] <= TRUE[WALL] <= wall["high_95"]
    assert wall["estimate"] == pytest.approx(TRUE[WALL], rel=1e-3)


def reflected_share(keys: dict[str, Any]) -> float:
    built = machine(MACHINE, None, KNOWN | keys)
    features = catalogue_entry(MACHINE).capabilities.features(built.parameters).features  # type: ignore[misc]
    (feature,) = (each for each in features if each.name == "reflected_share")
    seen = seen_run(built, MeasurementMap.model_validate(MAP), 0.8)
    channels = {column: sampled(times, times, values) for column, (times, values) in seen.items()}
    return feature.of(SampledCycle(0, 0.0, 0.8, channels))


def test_a_softer_wall_sends_more_back_through_the_gauge() -> None:
    """It yields like a free end, and holds the contact longer: the wave runs forth and back more often."""
    hard, middle, soft = (reflected_share({WALL: stiffness}) for stiffness in (2e8, 2e7, 2e6))
    assert 0.0 < hard < middle < soft < 1.0


def test_a_tool_without_waves_has_no_gauge() -> None:
    built = machine(MACHINE)
    with pytest.raises(ConfigurationError, match=r"channels\.1\.is.*expected a machine with a gauge on a struck rod"):
        SensorBench(MeasurementMap.model_validate(MAP), {}, built.coupling_step_s, gauge=built.gauge)
    with pytest.raises(StudyError, match="no gauge on this machine"):
        roll_out(built, 0.01, ()).gauge_numbers("blow", "peak_strain")
