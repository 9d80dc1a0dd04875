# SPDX-License-Identifier: Apache-2.0
"""A unit computes what a run does, to the bit, in the tools of others and where there is no Python."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmi_slave import Slave
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu

import mech_twin as mt
from mech_twin.cli.main import main
from mech_twin.engine.compiled_machine import compiled_machine
from mech_twin.errors import MotionError
from mech_twin.fmi.export import LINUX, WINDOWS, base_unit, export_fmu
from mech_twin.fmi.step_object import StepCode
from mech_twin.fmi.unit_variables import unit_of
from mech_twin.parameters.load import machine as built_machine

DURATION_S = 1.0
REAL = {"Real", "Float64"}
ALL_MACHINES = ["winding_drum", "vibration_crank", "compaction_press", "roller_former"]


def in_fmpy(file: Path, duration_s: float = DURATION_S, **asked: Any) -> np.ndarray:
    """Return what FMPy reads after every coupling step."""
    description = fmpy.read_model_description(str(file))
    names = [v.name for v in description.modelVariables if v.causality in ("output", "local")]
    step_s = float(description.defaultExperiment.stepSize)
    return fmpy.simulate_fmu(
        str(file), stop_time=duration_s, output_interval=step_s, step_size=step_s, output=names,
        fmi_type="CoSimulation", **asked,
    )  # fmt: skip


def same_as_run(found: np.ndarray, run: Any) -> list[str]:
    """Return the columns of a run that a unit gives otherwise, or not at all."""
    return [name for name in run.columns if name != "time_s" and found[name].tobytes() != run[name].tobytes()]


def assert_same_events(found: np.ndarray, run: Any) -> None:
    """Compare number, times and impulses of each kind of event of a unit with those of a run, to the bit."""
    events = run.event_numbers
    for kind in set(events.kind.tolist()):
        of_kind = events.kind == kind
        key = kind if f"event.{kind}.count" in found.dtype.names else f"body_{kind}"
        last = np.flatnonzero(np.diff(events.step[of_kind], append=np.inf))
        told = np.flatnonzero(np.diff(found[f"event.{key}.count"], prepend=0))
        assert found[f"event.{key}.count"][-1] == of_kind.sum()
        assert found[f"event.{key}.time_s"][told].tolist() == events.time_s[of_kind][last].tolist()
        assert found[f"event.{key}.impulse_ns"][told].tolist() == events.impulse_ns[of_kind][last].tolist()


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("impact_mass", 2),
        ("impact_mass", 3),
        pytest.param("mb10_breaker", 2, marks=pytest.mark.slow),
        *(pytest.param(name, 3, marks=pytest.mark.slow) for name in ALL_MACHINES),
    ],
)
def test_every_number_and_event_of_a_unit_is_that_of_a_run_to_the_bit(unit: Any, name: str, version: int) -> None:
    found, run = in_fmpy(unit(name, version)), mt.rollout(name, DURATION_S)
    assert same_as_run(found, run) == []
    assert_same_events(found, run)


@pytest.mark.parametrize("version", [2, 3])
def test_a_unit_keeps_to_the_standard(unit: Any, version: int) -> None:
    assert validate_fmu(str(unit("impact_mass", version))) == []


def test_every_number_that_has_a_unit_in_the_samples_has_it_in_the_description(unit: Any) -> None:
    units = mt.rollout("impact_mass", 0.0).samples.units
    described = {v.name: v.unit for v in fmpy.read_model_description(str(unit("impact_mass", 2))).modelVariables}
    for name in ("linkage.mass.position", "linkage.mass.velocity", "forces.stop.force_x_n"):
        if name in units:
            assert described[name] == units[name].replace(" ", ".")
    assert described["event.impact.impulse_ns"] == "N.s"
    assert described["parameters.period_s"] == "s"


with_wine = pytest.mark.skipif(shutil.which("wine") is None, reason="no wine, which runs programs of Windows")
BOTH = (LINUX, WINDOWS)  # a fresh machine compiles the C library of Windows for the first unit: a minute


@pytest.mark.parametrize(
    ("library", "target", "run_by"),
    [
        ("linux64/impact_mass.so", ("x86_64-linux-gnu.2.17", "-ldl"), ()),
        pytest.param("win64/impact_mass.dll", ("x86_64-windows-gnu",), ("wine",), marks=with_wine),
    ],
)
@pytest.mark.slow
def test_a_library_of_a_unit_needs_no_python(
    unit: Any, tmp_path: Path, library: str, target: tuple[str, ...], run_by: tuple[str, ...]
) -> None:
    file = unit("impact_mass", 2, BOTH) if run_by else unit("impact_mass", 2)
    with zipfile.ZipFile(file) as archive:
        archive.extract(f"binaries/{library}", tmp_path)
    description = fmpy.read_model_description(str(file))
    importer = tmp_path / "importer.exe"
    source = Path(__file__).with_name("importer.c")
    compiler = [sys.executable, "-m", "ziglang", "cc", "-w", "-o", str(importer), str(source), "-target", *target]
    subprocess.run(compiler, check=True)
    run = mt.rollout("impact_mass", 0.5)
    described = {v.name: v.valueReference for v in description.modelVariables}
    names = ["linkage.mass.position", "linkage.mass.velocity"]
    wine = {"WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all", "PATH": "/usr/bin:/bin"} if run_by else {}
    done = subprocess.run(
        [*run_by, str(importer), f"binaries/{library}", description.guid, "500", "0.001",
         *(str(described[name]) for name in (*names, "event.impact.time_s"))],
        cwd=tmp_path, env=wine, capture_output=True, text=True, check=True,
    )  # fmt: skip
    impacts = run.event_numbers.time_s[run.event_numbers.kind == "impact"]
    expected = [*(run[name][-1] for name in names), impacts[-1]]
    assert [float.fromhex(line) for line in done.stdout.split()] == expected


def assert_no_place(file: Path) -> None:
    """A unit names no directory of the machine that exported it."""
    with zipfile.ZipFile(file) as archive:
        content = b"".join(map(archive.read, archive.namelist()))
    places = {str(Path(module.__file__).parent) for module in (np, mt) if module.__file__}
    assert not [place for place in places if place.encode() in content]


def test_a_library_tells_nothing_of_the_machine_that_exported_it(unit: Any) -> None:
    assert_no_place(unit("impact_mass", 2))


@pytest.mark.slow
def test_a_library_for_windows_offers_the_functions_of_the_standard(unit: Any) -> None:
    file = unit("impact_mass", 2, BOTH)
    with zipfile.ZipFile(file) as archive:
        library = archive.read("binaries/win64/impact_mass.dll")
        assert archive.read("binaries/linux64/impact_mass.so")[:4] == b"\x7fELF"
    assert library[:2] == b"MZ"
    assert b"fmi2DoStep\0" in library
    assert b"python3" not in library.lower()
    assert_no_place(file)


def test_a_parameter_that_an_importer_sets_is_that_of_the_configuration(unit: Any) -> None:
    settings = {"period_s": 0.06, "phase1_duration_s": 0.021}
    found = in_fmpy(unit("impact_mass", 2), start_values={f"parameters.{key}": v for key, v in settings.items()})
    assert same_as_run(found, mt.rollout("impact_mass", DURATION_S, settings)) == []
    assert same_as_run(found, mt.rollout("impact_mass", DURATION_S)) != []


def test_a_parameter_beyond_what_was_tried_is_refused_with_its_bounds(unit: Any) -> None:
    told: list[str] = []
    with pytest.raises(Exception, match="SetReal"):
        in_fmpy(
            unit("impact_mass", 2), 0.01, validate=False, start_values={"parameters.period_s": 50.0},
            logger=lambda *words: told.append(str(words)),
        )  # fmt: skip
    least = next(
        v.min for v in fmpy.read_model_description(str(unit("impact_mass", 2))).modelVariables
        if v.name == "parameters.period_s"
    )  # fmt: skip
    assert any(f"parameter period_s, value 50: expected {float(least)!r} to 0.1;" in line for line in told)


@pytest.mark.parametrize("name", ["speed_command", "parameters.period_s"])
def test_a_number_that_is_not_finite_is_refused_by_its_name(unit: Any, name: str) -> None:
    with Slave(unit("impact_mass", 2)) as slave:
        with pytest.raises(Exception, match="SetReal"):
            slave.set(name, np.inf)
        assert f"{name.removeprefix('parameters.')} (value reference" in slave.said[-1]


def test_a_command_counts_from_the_next_step_on(unit: Any) -> None:
    command = np.where(np.arange(501) < 200, 1.0, 0.6)
    given = np.array(
        [(0.001 * i, value) for i, value in enumerate(command)], dtype=[("time", "f8"), ("speed_command", "f8")]
    )
    steps = np.concatenate([[1.0], command[:-1]])
    found = in_fmpy(unit("impact_mass", 3), 0.5, input=_held(given))
    assert same_as_run(found, mt.rollout("impact_mass", 0.5, command=steps)) == []


def _held(rows: np.ndarray) -> np.ndarray:
    """Return an input that jumps at each row instead of going on in a line."""
    before = rows.copy()[1:]
    before["speed_command"] = rows["speed_command"][:-1]
    before["time"] = np.nextafter(before["time"], 0.0)
    return np.sort(np.concatenate([rows, before]), order="time")


@pytest.mark.slow
def test_a_state_given_back_goes_on_with_the_same_bits_and_only_in_its_unit(unit: Any, tmp_path: Path) -> None:
    with Slave(unit("impact_mass", 2)) as slave:
        slave.begin()
        for step in range(150):
            slave.step(0.001 * step)
        stored = slave.fmu.serializeFMUstate(state := slave.fmu.getFMUstate())
        slave.fmu.freeFMUstate(state)
        with pytest.raises(Exception, match="Serialize"):
            slave.fmu.serializeFMUstate(None)
        once = _onward(slave)
        slave.fmu.setFMUstate(slave.fmu.deSerializeFMUstate(stored))
        assert _onward(slave) == once
    with Slave(unit("impact_mass", 2)) as other:
        other.begin()
        other.fmu.setFMUstate(other.fmu.deSerializeFMUstate(stored))
        assert _onward(other) == once
    machine = built_machine("impact_mass", None, {"period_s": 0.07})
    with Slave(export_fmu(machine, tmp_path / "unit.fmu").file) as foreign:  # as many bytes, and other constants
        with pytest.raises(Exception, match="DeSerialize"):
            foreign.fmu.deSerializeFMUstate(stored)
        assert foreign.get("parameters.period_s") == 0.07


def _onward(slave: Slave) -> list[float]:
    found = []
    for step in range(150, 300):
        slave.step(0.001 * step)
        found.append(slave.get("linkage.mass.velocity"))
    return found


@pytest.mark.parametrize("start_s", [0.0, -3.0, 1.76e9])
def test_a_long_step_ends_where_short_ones_do_at_any_start_time(unit: Any, start_s: float) -> None:
    ends = []
    for length in (1, 10, 250):
        with Slave(unit("impact_mass", 2)) as slave:
            slave.fmu.setupExperiment(startTime=start_s)
            slave.begin()
            for begin in range(0, 500, length):
                slave.fmu.doStep(start_s + 0.001 * begin, 0.001 * length)
            ends.append(slave.get("linkage.mass.velocity"))
    assert ends == [mt.rollout("impact_mass", 0.5)["linkage.mass.velocity"][-1]] * 3


@pytest.mark.parametrize(
    ("time_s", "step_s"),
    [(0.0, -0.001), (0.0, np.nan), (0.0, np.inf), (0.0, 1e30), (np.nan, 0.001), (5.0, 0.001), (-0.01, 0.02)],
)
def test_a_step_that_does_not_go_on_from_the_last_is_refused(unit: Any, time_s: float, step_s: float) -> None:
    with Slave(unit("impact_mass", 2)) as slave:
        with pytest.raises(Exception, match="DoStep"):
            slave.step(0.0)
        assert "a step before the initialization has ended" in slave.said[-1]
        slave.begin()
        slave.step(0.0)
        with pytest.raises(Exception, match="DoStep"):
            slave.step(time_s, step_s)
        assert "expected one onward from where the last ended, 0.001 s" in slave.said[-1]
        slave.step(0.001)
        assert slave.get("linkage.mass.velocity") == mt.rollout("impact_mass", 0.002)["linkage.mass.velocity"][-1]


def test_event_mode_ends_a_step_where_something_happened(unit: Any) -> None:
    file = str(unit("impact_mass", 3))
    found = fmpy.simulate_fmu(
        file, stop_time=0.5, output_interval=0.1, step_size=0.1, output=["event.impact.count", "event.phase.count"],
        use_event_mode=True, early_return_allowed=True,
    )  # fmt: skip
    events = mt.rollout("impact_mass", 0.5).event_numbers
    ends = {round(0.001 * step, 9) for step in events.step.tolist() if step % 100}
    assert ends <= set(np.round(found["time"], 9).tolist())
    assert found["event.impact.count"][-1] == (events.kind == "impact").sum()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--out", "x.zip"], "x.zip: expected a name that ends in .fmu"),
        (["--fmi", "4"], "--fmi"),
        (["--out", "there.fmu"], "there.fmu: exists already"),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_line(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    tmp_path.joinpath("there.fmu").touch()
    monkeypatch.setattr(sys, "argv", ["mech-twin", "export", "fmu", "winding_drum", *words])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    complaint = capsys.readouterr().err
    assert said in complaint
    assert complaint.count("\n") == 1


@pytest.mark.slow
def test_the_command_writes_a_unit_that_holds_its_configuration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["mech-twin", "export", "fmu", "impact", "--set", "period_s=0.12", "--fmi", "3"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0
    assert "impact_mass.fmu: FMI 3.0 co-simulation" in capsys.readouterr().out
    with zipfile.ZipFile("impact_mass.fmu") as archive:
        assert b"period_s: 0.12" in archive.read("resources/configuration.yaml")
    assert (
        same_as_run(in_fmpy(tmp_path / "impact_mass.fmu", 0.2), mt.rollout("impact_mass", 0.2, {"period_s": 0.12}))
        == []
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "more"), [("rammer", "friction:\n  seal: {joint: leg, coulomb_n: 5.0}\n"), ("rock_hammer", "")]
)
def test_a_unit_of_a_page_strikes_when_a_run_of_it_does_to_the_bit(name: str, more: str, tmp_path: Path) -> None:
    """Of pages with springs, gas, a damper, a contact, a rod, a drive, and friction that holds and slides."""
    text = (Path(__file__).resolve().parents[2] / "config" / "pages" / f"{name}.yaml").read_text(encoding="utf-8")
    page = str(tmp_path / f"{name}.yaml")
    Path(page).write_text(f"{text}{more}", encoding="utf-8")
    file = export_fmu(built_machine(page), tmp_path / "unit.fmu", 3).file
    found, run = in_fmpy(file), mt.rollout(page, DURATION_S)
    assert same_as_run(found, run) == []
    assert_same_events(found, run)
    assert (run.event_numbers.kind == "impact").sum() > 0
    assert validate_fmu(str(file)) == []
    assert fmpy.read_model_description(str(file)).coSimulation.modelIdentifier == name


@pytest.mark.slow
def test_a_unit_of_a_page_that_fails_names_the_element_as_a_run_does(tmp_path: Path) -> None:
    page = tmp_path / "ball.yaml"
    page.write_text(
        "bodies: {ball: {mass_kg: 1}}\n"
        "joints: {fall: {kind: slider, between: [ground, ball], direction_deg: 90, start_m: 0.1}}\n"
        "springs: {air: {between: [ground, ball], rate_n_per_m: 1.0, free_m: 0.1}}\n",
        encoding="utf-8",
    )
    built = built_machine(str(page))
    with pytest.raises(MotionError) as told:
        mt.rollout(str(page), 1.0)
    with Slave(export_fmu(built, tmp_path / "unit.fmu").file) as slave:
        slave.begin()
        with pytest.raises(FMICallException):
            slave.step(0.0, 1.0)
    assert "springs.air.between" in str(told.value)
    assert slave.said == [str(told.value)]


@pytest.mark.slow
def test_a_step_that_was_compiled_once_serves_other_numbers_and_no_other_structure() -> None:
    def code_of(overrides: dict[str, object]) -> StepCode:
        machine = built_machine("impact_mass", None, overrides)
        compiled = compiled_machine(machine)
        assert compiled is not None
        return StepCode(compiled, unit_of(machine, compiled).packed)

    first = code_of({}).object_file(LINUX.triple)
    again = code_of({"mass_kg": 3.0})
    assert again.object_file(LINUX.triple) == first
    assert "_compiled" not in vars(again)
    assert code_of({"coupling.step_s": 0.002}).object_file(LINUX.triple) != first


@pytest.mark.slow
def test_a_unit_of_measurement_is_described_by_its_powers_or_not_at_all() -> None:
    torque, inertia = {"kg": 1, "m": 2, "s": -2}, {"kg": 1, "m": 2}
    assert base_unit("N.m") == base_unit("N m") == (torque, 1.0)
    assert base_unit("kg.m2") == (inertia, 1.0)
    assert base_unit("N.m.s/rad") == ({**inertia, "s": -1, "rad": -1}, 1.0)
    assert base_unit("kg m^2") is None
    machine = built_machine("mb10_breaker")
    compiled = compiled_machine(machine)
    assert compiled is not None
    for variable in unit_of(machine, compiled).variables:
        assert variable.unit == "" or base_unit(variable.unit) is not None, variable
        if "inertia" in variable.name:
            assert base_unit(variable.unit) == (inertia, 1.0), variable
