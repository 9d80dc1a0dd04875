# SPDX-License-Identifier: Apache-2.0
"""``mech_twin.identify`` from Python: its table, what it draws and what it saves are one answer."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from browser import chromium

import mech_twin as mt
from mech_twin.cli.console import print_json
from mech_twin.cli.main import main
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.files.output_file import OutputError
from mech_twin.measurements.runs import read_run
from mech_twin.parameters.load import machine, machine_parameters
from mech_twin.results.opened_runs import given_map, opened_run
from mech_twin.studies.identification.fit_runs import FitRun, fit_run
from mech_twin.studies.identification.identification import identified
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.identification.written_identification import SavedIdentification

pytest.importorskip("matplotlib")
MACHINE, TRUE = "vibration_crank", {"crank_m": 0.131, "rod_m": 0.47}
UNSEEN = "masses.tree_kg"  # positions tell nothing of it
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


def pages(report: Path) -> int:
    """Return how many pages a report prints on."""
    printed = report.with_suffix(".pdf")
    options = ("--headless", "--no-sandbox", "--disable-gpu", f"--print-to-pdf={printed}")
    subprocess.run([chromium(), *options, str(report)], check=True, capture_output=True, timeout=120)
    return len(re.findall(rb"/Type\s*/Page\b", printed.read_bytes()))


@pytest.fixture(scope="module")
def plant(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    return measured(tmp_path_factory.mktemp("plant"))


@pytest.fixture(scope="module")
def found(plant: tuple[Path, Path]) -> SavedIdentification:
    return mt.identify(MACHINE, [plant[0]], plant[1], list(TRUE), cores=1)


@pytest.mark.slow
def test_all_keys_free_are_what_the_channels_see_and_the_others_stay(
    plant: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["mech-twin", "identify", MACHINE, str(plant[0]), "--map", str(plant[1]), "--free", "auto"]
    monkeypatch.setattr(sys, "argv", [*words, "--motion", "simulated", "--json"])
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


@pytest.mark.slow
def test_all_keys_free_are_the_lengths_where_only_positions_are_measured(
    plant: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The crank's speed is measured and masses move no position, so the measured motion is taken unasked."""
    words = ["mech-twin", "identify", MACHINE, str(plant[0]), "--map", str(plant[1])]
    answers = []
    for free in ([], ["--free", "crank_m", "--free", "auto"]):
        monkeypatch.setattr(sys, "argv", [*words, *free, "--set", "crank_m=0.1", "--set", "rod_m=0.6", "--json"])
        with pytest.raises(SystemExit) as end:
            main()
        printed = capsys.readouterr()
        assert not end.value.code, printed.err
        assert "free, since the measured positions depend on them: crank_m, rod_m" in printed.err
        answers.append({row["key"]: row for row in json.loads(printed.out)["parameters"]})
    assert answers[0] == answers[1]
    for key, true in TRUE.items():
        assert answers[0][key]["verdict"] == "identified"
        assert answers[0][key]["low_95"] <= true <= answers[0][key]["high_95"]


def test_the_table_holds_the_machine_that_was_measured(found: SavedIdentification) -> None:
    rows = {row["key"]: row for row in found.table}
    assert set(rows) == set(TRUE)
    for key, true in TRUE.items():
        assert rows[key]["verdict"] == "identified"
        assert rows[key]["low_95"] <= true <= rows[key]["high_95"]
        assert rows[key]["high_95"] - rows[key]["low_95"] < 0.02 * true
        assert repr(found).count(f"{rows[key]['estimate']:.6g}") >= 1
    assert found.better


@pytest.mark.slow
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
    assert report.count("<svg") == 2 + len(CHANNELS)  # intervals, correlation, and each channel
    for channel in document["channels"]:
        assert np.abs(channel["autocorrelation"]).max() < 4.0 / channel["samples"] ** 0.5
    assert set(document["intervals_before"]) == set(TRUE)
    for key, (low, high) in document["intervals_before"].items():
        assert low < TRUE[key] < high
        assert f"{low:.6g} to {high:.6g}" in report
    sensors = document["further_sensors"]
    assert max(each["narrowed"] for each in sensors) > 1.0
    assert all(each["identified"] or each["narrowed"] > 1.0 for each in sensors)
    assert f"<td>{sensors[0]['what']}</td>" in report
    assert pages(tmp_path / "found" / "report.html") <= 2
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


@pytest.mark.slow
@pytest.mark.parametrize(
    "share",
    [
        pytest.param(0.2, id="a share held out"),
        pytest.param(0.0, id="nothing held out"),
    ],
)
def test_what_identify_prints_as_json_is_the_same_object_in_python(
    share: float,
    plant: tuple[Path, Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    bounds, prior = {"crank_m": (0.1, 0.2)}, {"rod_m": (0.47, 0.1)}
    free = ["--free", "crank_m=0.1:0.2", "--free", "rod_m", "--free", UNSEEN, "--prior", "rod_m=0.47,0.1"]
    words = [MACHINE, str(plant[0]), "--map", str(plant[1]), "--motion", "simulated", "--cores", "1", *free]
    monkeypatch.setattr(sys, "argv", ["mech-twin", "identify", *words, "--hold-out", str(share), "--json"])
    with pytest.raises(SystemExit):
        main()
    told = tmp_path / "told.json"
    told.write_text(capsys.readouterr().out, encoding="utf-8")
    keys = [*bounds, *prior, UNSEEN]
    asked = identified(
        IdentificationQuestion(MACHINE, machine_parameters(MACHINE), tuple(keys), bounds, prior, cores=1),
        [_measured_run(plant)],
        share=share,
    )
    read = mt.from_json(told)
    assert isinstance(read, SavedIdentification)
    assert (read.runs, read.held_out, read.map_file) == ((plant[0],), (), plant[1])
    told_of = replace(asked, fitted=None, seconds=read.found.seconds)
    np.testing.assert_equal(asdict(read.found), asdict(told_of))
    assert math.isnan(next(row["standard_error"] for row in read.table if row["key"] == UNSEEN))
    assert (read.found.held_out is None) == (share == 0.0)
    assert read.better == asked.better
    assert [line.get_xdata()[0] for line in read.plot().axes[0].lines]
    written = {path.name: path.read_text(encoding="utf-8") for path in read.save(tmp_path / "found")}
    assert machine_parameters(MACHINE, tmp_path / "found" / f"{MACHINE}.yaml") == asked.parameters
    assert "holds no runs to draw" in written["report.html"]


def test_numbers_without_bound_are_the_same_from_json(
    found: SavedIdentification, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key, *others = found.found.keys
    boundless = replace(
        found.found,
        question=replace(found.found.question, bounds={"crank_m": (-math.inf, math.inf)}),
        parameters=machine_parameters(MACHINE, None, {"rod_m": math.inf}),
        keys=(replace(key, low_95=-math.inf, high_95=math.inf), *others),
        search=replace(found.found.search, margin=math.inf),
        fitted=None,
    )
    print_json(replace(found, found=boundless).document)
    (tmp_path / "told.json").write_text(capsys.readouterr().out, encoding="utf-8")
    np.testing.assert_equal(asdict(mt.from_json(tmp_path / "told.json").found), asdict(boundless))


def _measured_run(plant: tuple[Path, Path]) -> FitRun:
    channels = given_map(plant[1], machine(MACHINE))
    with opened_run(plant[0]) as reader:
        return fit_run(read_run(reader, channels), begin_known=True)


def test_a_map_of_another_machine_is_refused(plant: tuple[Path, Path], tmp_path: Path) -> None:
    other = tmp_path / "map.yaml"
    other.write_text(plant[1].read_text().replace(MACHINE, "mb10_breaker"))
    with pytest.raises(ConfigurationError, match="expected a column of mb10_breaker"):
        mt.identify(MACHINE, [plant[0]], other, ["crank_m"])


@pytest.mark.slow
def test_what_contradicts_the_machine_is_a_warning(plant: tuple[Path, Path], tmp_path: Path) -> None:
    head, *rows = plant[0].read_text().splitlines()
    numbers = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    in_millimetres = tmp_path / "plant.csv"
    np.savetxt(in_millimetres, numbers * (1.0, 1.0, 1000.0), delimiter=",", header=head, comments="")
    with pytest.warns(UserWarning, match=r"plant\.csv: linkage\.slider\.position .* is its unit mm\?"):
        mt.identify(MACHINE, [in_millimetres], plant[1], ["crank_m"], cores=1)


def test_two_sensors_of_one_quantity_are_scored_each_by_its_own(plant: tuple[Path, Path], tmp_path: Path) -> None:
    """The rough one is judged by its own noise: that of the fine one would refute a fit that is right."""
    table, given = tmp_path / "two.csv", tmp_path / "two.yaml"
    rows, rough = np.genfromtxt(plant[0], delimiter=",", names=True), 5e-3
    again = rows["slide"] + rough * np.random.default_rng(5).standard_normal(len(rows))
    columns = np.column_stack([rows["t"], rows["wheel"], again, rows["slide"]])
    np.savetxt(table, columns, delimiter=",", header="t,wheel,rough,slide", comments="")
    tree = yaml.safe_load(plant[1].read_text(encoding="utf-8"))
    wheel, slide = tree["channels"]
    other = {**slide, "source": {"column": "rough"}, "sigma": rough}
    given.write_text(yaml.safe_dump({**tree, "channels": [wheel, slide, other]}))
    document = mt.identify(MACHINE, [table], given, list(TRUE), cores=1).document
    expected = {f"{slide['is']} (slide)": slide["sigma"], f"{slide['is']} (rough)": rough}
    rms = {each["is"]: each["rms"] for each in document["channels"][1:]}
    assert rms == pytest.approx(expected, rel=0.2)
    assert {name: document["held_out"]["rms"][name] for name in expected} == pytest.approx(expected, rel=0.5)
