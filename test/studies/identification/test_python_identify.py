# SPDX-License-Identifier: Apache-2.0
"""``mech_twin.identify`` from Python: its table, what it draws and what it saves are one answer."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import mech_twin as mt
from mech_twin.cli.main import main
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.files.output_file import OutputError
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.identification.saved_identification import SavedIdentification

pytest.importorskip("matplotlib")
MACHINE, TRUE = "vibration_crank", {"crank_m": 0.131, "rod_m": 0.47}
CHANNELS = {"linkage.crank.position": 0.002, "linkage.slider.position": 3e-4}


def measured(folder: Path) -> tuple[Path, Path]:
    """Write a run of another machine as its sensors show it, and its map."""
    run = mt.simulate(MACHINE, 1.2, TRUE)
    random = np.random.default_rng(4)
    times = run.samples["time_s"][::10]
    noisy = [run.samples[name][::10] + noise * random.standard_normal(len(times)) for name, noise in CHANNELS.items()]
    table = folder / "plant.csv"
    np.savetxt(table, np.column_stack([times, *noisy]), delimiter=",", header="t,wheel,slide", comments="")
    channels = [
        {"source": {"column": column}, "is": name, "sigma": noise}
        for column, (name, noise) in zip(("wheel", "slide"), CHANNELS.items(), strict=True)
    ]
    given = folder / "map.yaml"
    given.write_text(yaml.safe_dump({"machine": MACHINE, "time": {"column": "t"}, "channels": channels}))
    return table, given


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return measured(tmp_path_factory.mktemp("plant"))


@pytest.fixture(scope="module")
def found(plant: tuple[Path, Path]) -> SavedIdentification:
    return mt.identify(MACHINE, [plant[0]], plant[1], list(TRUE), cores=1)


def test_all_keys_free_are_what_the_channels_see_and_the_others_stay(
    plant: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["mech-twin", "identify", MACHINE, str(plant[0]), "--map", str(plant[1]), "--free", "auto"]
    monkeypatch.setattr(sys, "argv", [*words, "--json"])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert not end.value.code, told.err
    rows = {row["key"]: row for row in json.loads(told.out)["parameters"]}
    seen = {key for key, row in rows.items() if row["verdict"] == "identified"}
    assert seen == {*TRUE, "drive.speed_rpm"}
    for key, true in TRUE.items():
        assert rows[key]["low_95"] <= true <= rows[key]["high_95"]
    assert all(rows[key]["estimate"] == rows[key]["before"] for key in rows.keys() - seen)
    assert len(rows) > 10
    monkeypatch.setattr(sys, "argv", [*words, "--motion", "measured"])
    with pytest.raises(SystemExit) as end:
        main()
    told = capsys.readouterr()
    assert end.value.code and told.err.startswith("mech-twin: --free auto: expected keys, or --motion simulated")
    assert len(told.err.splitlines()) == 1


def test_the_table_holds_the_machine_that_was_measured(found: SavedIdentification) -> None:
    rows = {row["key"]: row for row in found.table}
    assert set(rows) == set(TRUE)
    for key, true in TRUE.items():
        assert rows[key]["verdict"] == "identified"
        assert rows[key]["low_95"] <= true <= rows[key]["high_95"]
        assert rows[key]["high_95"] - rows[key]["low_95"] < 0.02 * true
        assert repr(found).count(f"{rows[key]['estimate']:.6g}") >= 1
    assert found.better


def test_what_is_saved_is_the_table_and_a_configuration_that_runs(found: SavedIdentification, tmp_path: Path) -> None:
    written = found.save(tmp_path / "found")
    assert sorted(path.name for path in written) == ["identification.json", "report.html", f"{MACHINE}.yaml"]
    document = json.loads((tmp_path / "found" / "identification.json").read_text(encoding="utf-8"))
    assert document["parameters"] == json.loads(json.dumps(found.table))
    loaded = machine_parameters(MACHINE, tmp_path / "found" / f"{MACHINE}.yaml")
    assert loaded == found.parameters
    report = (tmp_path / "found" / "report.html").read_text(encoding="utf-8")
    for row in found.table:
        assert row["key"] in report
    assert report.count("<svg") >= 2
    assert "http-equiv" not in report
    with pytest.raises(OutputError):
        found.save(tmp_path / "found")
    assert found.save(tmp_path / "found", force=True) == written


def test_the_picture_shows_the_interval_of_each_key(found: SavedIdentification) -> None:
    (axes,) = found.plot().axes
    rows = {row["key"]: row for row in found.table}
    names = [label.get_text() for label in axes.get_yticklabels()]
    assert set(names) == set(rows)
    bars = [line.get_xdata() for line in axes.lines if len(line.get_xdata()) == 2 and line.get_ydata()[0] in (0, 1)]
    for name, bar in zip(names, bars, strict=False):
        row = rows[name]
        ends = [100.0 * (row[end] / row["before"] - 1.0) for end in ("low_95", "high_95")]
        np.testing.assert_allclose(np.sort(np.asarray(bar, dtype=float)), ends, rtol=1e-12)


def test_a_map_of_another_machine_is_refused(plant: tuple[Path, Path], tmp_path: Path) -> None:
    other = tmp_path / "map.yaml"
    other.write_text(plant[1].read_text().replace(MACHINE, "mb10_breaker"))
    with pytest.raises(ConfigurationError, match="expected a column of mb10_breaker"):
        mt.identify(MACHINE, [plant[0]], other, ["crank_m"])
