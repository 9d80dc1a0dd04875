# SPDX-License-Identifier: Apache-2.0
"""``mech-twin compare``: recordings and configurations side by side."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import mech_twin
from recordings import altered_bag

from mech_twin.engine.trajectory import Trajectory

BAGS = Path(__file__).parents[2] / "bags"
CONFIG = Path(__file__).parents[2] / "config"


@pytest.fixture
def changed(tmp_path: Path) -> Path:
    text = (CONFIG / "compaction_press.yaml").read_text(encoding="utf-8")
    file = tmp_path / "changed.yaml"
    file.write_text(text.replace("peak_n: 10000.0", "peak_n: 12000.0"), encoding="utf-8")
    return file


@pytest.mark.slow
def test_a_machine_equals_itself_and_a_changed_one_is_named_by_key_and_numbers(changed, tmp_path):
    assert mech_twin("compare", "compaction_press", CONFIG / "compaction_press.yaml", "--duration", 0.2).code == 0
    picture = tmp_path / "apart.svg"
    words = ("compaction_press", changed, "--duration", 0.2, "--json", "--picture", picture)
    found = mech_twin("compare", *words, "--tolerance", 0.01)
    assert found.code == 1, found.err
    document = json.loads(found.out)
    assert [(item["name"], item["first"], item["second"]) for item in document["settings"]] == [
        ("working_force.peak_n", 10000.0, 12000.0)
    ]
    numbers = {item["name"]: item for item in document["numbers"]}
    assert numbers["work_per_cycle_j"]["second"] == pytest.approx(1.2 * numbers["work_per_cycle_j"]["first"])
    assert numbers["stroke_m"]["relative"] == 0.0
    assert "<svg" in picture.read_text(encoding="utf-8")
    again = mech_twin("compare", *words)
    assert again.code == 2
    assert "--force" in again.err


@pytest.mark.slow
def test_a_recording_equals_the_configuration_it_was_made_with(ros_domain, tmp_path):
    bag = tmp_path / "bag"
    assert mech_twin("simulate", "compaction_press", "--duration", "0.3", "--bag", bag).code == 0
    found = mech_twin("compare", bag, "compaction")  # the beginning of a machine's name, as everywhere
    assert found.code == 0, found.out + found.err
    assert "within a tolerance of 0" in found.out


@pytest.mark.slow
def test_another_length_of_the_run_is_said(tmp_path):
    bag = tmp_path / "bag"
    assert mech_twin("simulate", "compaction_press", "--duration", "0.3", "--bag", bag).code == 0
    assert "A ends at 0.3 s, B at 0.2 s" in mech_twin("compare", bag, "compaction", "--duration", "0.2").err
    assert "ends at" not in mech_twin("compare", bag, "compaction").err
    kept = altered_bag(bag, tmp_path / "late", lambda entry: [entry] if entry.log_time_ns >= 200_000_000 else [])
    told = mech_twin("compare", kept, "compaction").err
    assert "A begins at 0.2 s, B at 0 s: numbers of the whole run differ by that alone" in told


@pytest.mark.slow
def test_numbers_that_begin_anew_after_a_gap_are_said_to(tmp_path):
    bag = tmp_path / "bag"
    assert mech_twin("simulate", "compaction_press", "--duration", "0.4", "--bag", bag).code == 0
    gap_ns = range(100_000_000, 250_000_000)
    cut = altered_bag(bag, tmp_path / "cut", lambda entry: [] if entry.log_time_ns in gap_ns else [entry])
    said = "the numbers of the run count from 0.25 s: a reset, or a gap in a recording, begins them anew"
    assert mech_twin("compare", cut, bag).err == f"{cut}: {said}\n"
    assert said in mech_twin("view", cut, "--save", tmp_path / "cut.rrd").err
    assert "begins them anew" not in mech_twin("compare", bag, bag).err


@pytest.mark.parametrize("name", ["run.csv", "run.parquet"])
def test_a_table_is_told_from_a_damaged_recording(name, tmp_path):
    (tmp_path / name).write_text("time_s,crank\n0,1\n1,2\n", encoding="utf-8")
    found = mech_twin("compare", "compaction_press", tmp_path / name, "--duration", 0.01)
    assert found.code == 2
    assert "is a table, no MCAP recording" in found.err


@pytest.mark.parametrize(
    ("second", "said"),
    [("winding_drum", "expected one machine"), ("nowhere", "nowhere"), ("nowhere.yaml", "nowhere.yaml")],
)
def test_what_cannot_be_compared_is_one_line(second, said):
    found = mech_twin("compare", "compaction_press", second, "--duration", 0.01)
    assert found.code == 2
    assert len(found.err.strip().splitlines()) == 1
    assert said in found.err


def test_the_name_that_stands_on_a_page_is_told_in_refusals_and_documents():
    found = mech_twin("compare", "config/pages/spring_hammer.yaml", "impact_mass", "--duration", 0.01)
    assert (found.code, "is spring_hammer, B (impact_mass) impact_mass" in found.err) == (2, True)
    found = mech_twin("compare", *["config/pages/slider_crank.yaml"] * 2, "--duration", 0.01, "--json")
    assert json.loads(found.out)["machine"] == "slider_crank"


def test_two_machines_are_told_apart_before_either_is_read_or_computed(monkeypatch, ros_domain, tmp_path):
    bag = tmp_path / "bag"
    assert mech_twin("simulate", "compaction_press", "--duration", "0.01", "--bag", bag).code == 0
    for how in ("simulate", "read"):
        monkeypatch.setattr(f"mech_twin.cli.compare._Side.{how}", lambda *_: pytest.fail("read or computed in vain"))
    found = mech_twin("compare", bag, "winding_drum")
    assert (found.code, "expected one machine" in found.err) == (2, True)


def test_a_change_during_a_recorded_run_is_said_at_the_terminal_and_on_the_page(monkeypatch, ros_domain, tmp_path):
    bag = tmp_path / "bag"
    change = ("--change", "working_force.peak_n=-20%@0.1")
    assert mech_twin("simulate", "compaction_press", "--duration", "0.2", "--bag", bag, *change).code == 0
    found = mech_twin("compare", bag, "compaction_press")
    said = f"{bag}: parameters changed 1 time during the run; the settings are those at its start"
    assert said in found.err

    class Noted:
        """A bench and its links that keep what they are told."""

        page, destination, told = "", "", []

        def tell(self, kind, content):
            self.told.append((kind, content))
            return True

        def show(self, picture):
            return True

        def close(self):
            pass

    monkeypatch.setattr("mech_twin.cli.compare.opened_bench", lambda *_, **__: Noted())
    monkeypatch.setattr("mech_twin.cli.compare.hold_view", lambda page: None)
    for link in ("BenchLink", "OverlayLink"):
        monkeypatch.setattr(f"mech_twin.view.bench.link.{link}", lambda *_: Noted())
    mech_twin("compare", bag, "compaction_press", "--view", "web")
    assert dict(Noted.told)["comparison"]["note"] == said


def test_recorded_samples_that_are_not_used_are_said(ros_domain, tmp_path):
    bag = tmp_path / "bag"
    assert mech_twin("simulate", "compaction_press", "--duration", "0.1", "--bag", bag).code == 0
    twice = altered_bag(bag, tmp_path / "twice", lambda entry: (entry, entry))
    found = mech_twin("compare", twice, bag)
    assert (found.code, found.err) == (0, f"{twice}: 303 recorded samples not used: repeated\n")


def test_a_comparison_without_a_picture_keeps_no_samples(monkeypatch, tmp_path):
    kept = []
    monkeypatch.setattr(Trajectory, "append", lambda own, frame: kept.append(frame))
    assert mech_twin("compare", "compaction_press", "compaction_press", "--duration", 0.1).code == 0
    assert not kept
