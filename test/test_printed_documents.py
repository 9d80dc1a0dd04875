# SPDX-License-Identifier: Apache-2.0
"""What any verb prints with ``--json`` is an object of Python again: that of its function, or one with its keys."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from shutil import copyfile, copytree
from typing import Any

import numpy as np
import pytest
import yaml
from command_line import in_a_process, mech_twin

import mech_twin as mt
from mech_twin.cli.main import EXPORTS, QUESTIONS, VERBS
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.errors import StudyError
from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import configuration_file, machine_parameters
from mech_twin.recording.recovery import recover
from mech_twin.results.printed_documents import PrintedDocument
from mech_twin.results.written_documents import KINDS
from mech_twin.studies import designs, regimes, search_runs, synthesise

pytest.importorskip("pyarrow")
ROOT = Path(__file__).resolve().parents[1]
BAGS, STORY = ROOT / "bags", ROOT / "bags" / "weak_spring"
DRUM = ROOT / "benchmarks" / "monitoring" / "sensors" / "winding_drum.yaml"
OF_STORY = ("--map", STORY / "map.yaml", "--config", STORY / "mb10_breaker.yaml")
WATCHED = ("monitor", "mb10_breaker", STORY / "watched", "--skip", "0", *OF_STORY, "--baseline", STORY / "healthy.json")
SENSORS = {
    "machine": "vibration_crank",
    "channels": [
        {"source": {"column": "wheel"}, "is": "linkage.crank.position", "rate_hz": 200.0},
        {"source": {"column": "slide"}, "is": "linkage.slider.position", "rate_hz": 200.0, "sigma": 1e-4},
    ],
}
SPEED_M_PER_S = 2.0
ROBUST = ("--impact-speed", "2", "--starts", "10", "--tolerance", "0.001")
CYCLE = {"starts": 10, "tolerance": 0.001}
SLOW = pytest.mark.slow
OF_RUNS = ("--objective", "shaft_force_max_n", "--duration", "0.1", "--cores", "1")
ECCENTRIC = {"eccentricity_m": (0.001, 0.002)}
LONG = (
    "study search",
    "study search by runs",
    "study size",
    "study size by runs",
    "study designs",
    "study synthesise",
    "study regimes",
    "fleet",
    "run",
    "identify measured",
    "identify plan",
    "monitor design",
    "monitor",
    "shadow",
    "export fmu",
)  # to compute or to compile
WORDS = {
    "list": ("list",),
    "simulate": ("simulate", "mb10_breaker", "--duration", "0.3", "--samples"),
    "simulate without bound": ("simulate", "vibration_crank", "--set", "rod_m=.inf", "--duration", "0.1", "--samples"),
    "analyse": ("analyse", "compaction_press", "--cycle", "4"),
    "reproduce": ("reproduce", "winding_drum"),
    "recover": ("recover", BAGS / "impact_mass", "salvaged"),
    "study size": ("study", "compaction_press", "size"),
    "study size by runs": ("study", "mb10_breaker", "size", "--tolerance", "0"),
    "study sweep": ("study", "winding_drum", "sweep", "--over", "package_radius_m=0.1,0.12", "--no-picture"),
    "study search": ("study", "compaction_press", "search", "--bound", "crank=0.04:0.06"),
    "study search by runs": ("study", "winding_drum", "search", *OF_RUNS, "--bound", "eccentricity_m=0.001:0.002"),
    "study designs": ("study", "compaction_press", "designs", "--count", "400", "--out", "designs.parquet"),
    "study synthesise": ("study", "impact_mass", "synthesise", *ROBUST, "--periods", "50"),
    "study regimes": ("study", "impact_mass", "regimes", "--over", "phase1_duration_s=0.02,0.03", "--settling", "50"),
    "run": ("run", "impact_mass", "--duration", "0.1", "--pace", "max", "--view", "none", "--record", "run"),
    "replay": ("replay", BAGS / "impact_mass", "--resimulate"),
    "replay measured": ("replay", "run.csv", "--analyse", "--map", "map.yaml"),
    "info": ("info", BAGS / "impact_mass"),
    "info measured": ("info", "run.csv", "--map", "map.yaml"),
    "map": ("map", BAGS / "impact_mass", "impact_mass"),
    "check": ("check", ROOT / "config" / "pages" / "spring_hammer.yaml"),
    "identify bounces": ("identify", "impact_mass", "drop.csv"),
    "identify measured": ("identify", "vibration_crank", "run.csv", "--map", "map.yaml", "--free", "crank_m"),
    "identify plan": ("identify", "winding_drum", "--plan", "--sensors", DRUM, "--duration", "2"),
    "monitor": (*WATCHED, "--explain", "spring_soft"),
    "monitor design": ("monitor", "winding_drum", "--design", "--sensors", DRUM),
    "fleet": ("fleet", "mb10_breaker", "hall", "--skip", "0", *OF_STORY, "--cores", "1"),
    "shadow": ("shadow", "winding_drum", "--from", "elsewhere", "--duration", "0.3"),
    "export fmu": ("export", "fmu", "impact_mass"),
}  # fmt: skip
FUNCTIONS: dict[str, Callable[[], Any]] = {
    "list": mt.machine_names,
    "simulate": lambda: mt.simulate("mb10_breaker", 0.3),
    "simulate without bound": lambda: mt.simulate("vibration_crank", 0.1, {"rod_m": math.inf}),
    "analyse": lambda: mt.analyse("compaction_press", positions=4),
    "reproduce": lambda: mt.reproduce("winding_drum"),
    "recover": lambda: recover(BAGS / "impact_mass", "salvaged", force=True),
    "study size": lambda: mt.size("compaction_press"),
    "study size by runs": lambda: mt.size("mb10_breaker", tolerance=0.0),
    "study sweep": lambda: mt.sweep("winding_drum", {"package_radius_m": [0.1, 0.12]}, cores=1),
    "study search": lambda: mt.search("compaction_press", bounds={"crank": (0.04, 0.06)}),
    "study search by runs": lambda: [
        search_runs("winding_drum", "shaft_force_max_n", ECCENTRIC, duration_s=0.1, cores=1)
    ],
    "study designs": lambda: designs("compaction_press", 400),
    "study synthesise": lambda: synthesise("impact_mass", SPEED_M_PER_S, options=CYCLE, periods=50),
    "study regimes": lambda: regimes("impact_mass", [0.02, 0.03], "phase1_duration_s", settling_periods=50),
}


@pytest.fixture
def plant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ros_domain: int) -> Path:
    """Give a directory with a measured run and its map, a ball that was dropped, and a hall with one machine."""
    monkeypatch.chdir(tmp_path)
    Path("map.yaml").write_text(yaml.safe_dump(SENSORS, sort_keys=False), encoding="utf-8")
    run = mech_twin("simulate", "vibration_crank", "--duration", "2", "--sensors", "map.yaml", "--table", "run.csv")
    assert run.code == 0, run.err
    rises = np.cumsum(np.r_[0.0, 0.5 * 0.7 ** np.arange(9)])
    times = np.arange(0.0, rises[-1], 0.001)
    flight = np.searchsorted(rises, times, side="right") - 1
    since, length = times - rises[flight], np.diff(rises)[flight]
    np.savetxt("drop.csv", np.c_[times, 4.9 * since * (length - since)], "%.9g", ",", header="t,y", comments="")
    copytree(STORY / "watched", "hall/m0/watched")
    copyfile(STORY / "healthy.json", "hall/m0/baseline.json")
    Path("hall/m1").mkdir()
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("case", [pytest.param(case, marks=SLOW) if case in LONG else case for case in WORDS])
def test_what_a_verb_prints_as_json_is_an_object_in_python(case: str, plant: Path) -> None:
    ended = (in_a_process if case in ("run", "shadow") else mech_twin)(*WORDS[case], "--json")
    plant.joinpath("told.json").write_text(ended.out, encoding="utf-8")
    assert ended.out, ended.err
    read, document = mt.from_json("told.json"), json.loads(ended.out)
    if case in FUNCTIONS:
        expected = FUNCTIONS[case]()
        assert type(read) is type(expected) and plain(read) == plain(expected)
        if hasattr(expected, "to_pandas"):
            assert read.to_pandas().equals(expected.to_pandas())
    else:
        assert isinstance(read, PrintedDocument) or case == "fleet"
        holds(read if case != "fleet" else as_told(read), document)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        pytest.param("roller_former", None, id="a side lacks settings"),
        pytest.param("vibration_crank", {"rod_m": math.inf}, id="an infinite setting"),
    ],
)
def test_what_compare_prints_as_json_is_the_comparison_in_python(
    name: str, settings: dict[str, Any] | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    other = configuration_file("roller_former_1") if settings is None else tmp_path / "other.yaml"
    if settings is not None:
        other.write_text(description_text(name, machine_parameters(name, None, settings)), encoding="utf-8")
    ended = mech_twin("compare", name, other, "--duration", "0.1", "--json")
    Path("told.json").write_text(ended.out, encoding="utf-8")
    read = mt.from_json("told.json")
    told, expected = (
        [[plain(row._asdict()) for row in rows] for rows in (result.found.settings, result.found.numbers)]
        for result in (read, mt.compare(mt.simulate(name, 0.1), mt.simulate(name, 0.1, config=other)))
    )
    assert told == expected and all(told)
    with pytest.raises(StudyError, match="holds no columns"):
        read.plot()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not JSON"),
        ("[1, 2]", "expected what one of these printed with --json: simulate, "),
        ('{"machine": "winding_drum", "config": {}, "summary": {}}', "config"),
        ('{"all_gated_hold": true, "rows": [{"a": 1}]}', "not as `reproduce` prints it"),
        ('{"machine": 1, "values": {}, "messages_sent": {}, "black_boxes": []}', "`shadow` prints it: key 'machine'"),
    ],
)
def test_a_document_of_no_verb_is_refused_in_one_line(text: str, said: str, tmp_path: Path) -> None:
    tmp_path.joinpath("told.json").write_text(text, encoding="utf-8")
    with pytest.raises((StudyError, ConfigurationError), match=re.escape(said)) as refused:
        mt.from_json(tmp_path / "told.json")
    assert "\n" not in str(refused.value)


def test_every_verb_that_prints_json_has_an_object_in_python() -> None:
    groups = (("", VERBS), ("study ", QUESTIONS), ("export ", EXPORTS))
    printing = {f"{group}{name}" for group, verbs in groups for name in verbs if "as_json" in verbs[name].model_fields}
    assert printing == {kind.verb for kind in KINDS}


def as_told(fleet: Any) -> dict[str, Any]:
    """Return a fleet by the keys of its document."""
    sisters = [{**sister.member._asdict(), **sister._asdict()} for sister in fleet.sisters]
    return {
        **fleet._asdict(),
        "machine": "mb10_breaker",
        "machines": sisters,
        "refused": {m.name: m.refused for m in fleet.refused},
    }


def holds(read: Any, told: Any) -> None:
    """Check that everything that was told is in the object, by the same name; null is what was not finite."""
    if isinstance(told, dict):
        for key, value in told.items():
            holds(read[key] if isinstance(read, Mapping) else getattr(read, "quantity" if key == "is" else key), value)
    elif isinstance(told, list):
        assert len(read) == len(told)
        for one, other in zip(read, told, strict=True):
            holds(one, other)
    elif told is None:
        assert read is None or not math.isfinite(read)
    else:
        assert (str(read) if isinstance(read, Path) else read) == told


def plain(value: Any) -> Any:
    """Return a result as values that compare, numbers by their bits, without titles of tables and what draws them."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value.tolist()]
    if isinstance(value, float):
        return value.hex()
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    return None if callable(value) else value
