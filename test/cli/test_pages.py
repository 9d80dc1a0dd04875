# SPDX-License-Identifier: Apache-2.0
"""Verbs on pages: a page to start from, its check, a run by its path, and a bag that explains itself."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from recordings import decoded_messages
from rrd_tables import rrd_tables
from typer.testing import CliRunner

from mech_twin import studies
from mech_twin.cli.console import CommandError
from mech_twin.cli.machines import shipped_pages
from mech_twin.cli.main import app
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.errors import StudyError
from mech_twin.files.output_file import OutputError
from mech_twin.parameters.load import machine_parameters

RUNNER = CliRunner()
FORMER = Path(__file__).parents[1] / "machines" / "page" / "former_linkages.json"


def answer(*words):
    """Return what a command writes; its error is raised."""
    result = RUNNER.invoke(app, [str(word) for word in words], catch_exceptions=False, standalone_mode=False)
    if result.exception is not None:
        raise result.exception
    return result.output


@pytest.fixture
def page(tmp_path):
    file = tmp_path / "my.yaml"
    file.write_text(answer("new", "spring_hammer"), encoding="utf-8")
    return file


@pytest.mark.parametrize("kind", shipped_pages())
def test_every_page_to_start_from_passes_its_check(tmp_path, kind):
    file = tmp_path / "mine.yaml"
    file.write_text(answer("new", kind), encoding="utf-8")
    found = json.loads(answer("check", file, "--json"))
    assert found["numbers"]["freedoms"] + found["numbers"]["driven_joints"] >= 1


def test_check_draws_the_machine(page, tmp_path):
    picture = tmp_path / "my.png"
    answer("check", page, "--picture", picture)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.stat().st_size > 5000


def test_check_tells_the_gap_of_rigid_and_compliant_contacts_in_the_page_s_units(tmp_path):
    file = tmp_path / "my.yaml"
    text = """
        name: mine
        gravity_m_per_s2: [0, 0]
        bodies: {arm: {inertia_kg_m2: 1}, ram: {mass_kg: 2}}
        joints:
          pivot: {kind: revolute, between: [ground, arm], start_deg: 40}
          guide: {kind: slider, between: [ground, ram], start_m: -0.1}
        springs: {rest: {joint: guide, rate_n_per_m: 1e4, free_m: -0.1}}
        contacts:
          soft: {point: ram, line: ground, normal_deg: 180, stiffness_n_per_m: 1e6}
          stop: {joint: pivot, least_deg: 10, restitution: 0}
        """
    file.write_text(text, encoding="utf-8")
    gaps = {
        contact["contact"]: (contact["gap"], contact["unit"])
        for contact in json.loads(answer("check", file, "--json"))["contacts"]
    }
    assert gaps == {"soft": (pytest.approx(0.1), "m"), "stop": (pytest.approx(np.pi / 6.0), "rad")}
    told = answer("check", file)
    assert ["pivot", "revolute", "free", "40", "deg"] in [line.split() for line in told.splitlines()]
    assert ["stop", "open", "30", "deg"] in [line.split() for line in told.splitlines()]
    assert "rest gives 0 N at the start" in told


def test_a_page_stands_where_a_machine_s_name_does(page):
    found = json.loads(answer("simulate", page, "--duration", "1", "--json"))
    assert found["config"]["name"] == "spring_hammer"
    assert found["summary"]["blow_impacts"] >= 1
    assert {event["contact"] for event in found["events"]} <= {"blow", "ram_friction"}
    assert all(residual["worst"] <= residual["limit"] for residual in found["residuals"].values())


def test_a_key_of_the_page_is_set_by_its_names(page):
    found = json.loads(
        answer("simulate", page, "--duration", "0.1", "--json", "--set", "springs.spring.rate_n_per_m=9000")
    )
    assert found["config"]["springs"]["spring"]["rate_n_per_m"] == 9000.0


def test_a_bag_of_a_page_is_computed_anew_to_the_bit_without_the_page(page, tmp_path):
    bag = tmp_path / "bag"
    answer("simulate", page, "--duration", "0.5", "--bag", bag)
    told = answer("info", bag)
    assert told.startswith("spring_hammer, 0.5 s; complete")
    (described,) = decoded_messages(bag, "/spring_hammer/robot_description")
    assert described.data.startswith('<robot name="spring_hammer">')
    assert "topics below /spring_hammer/" in told  # where `run` publishes them
    page.unlink()
    assert re.search(r"^machine +spring_hammer$", answer("replay", bag, "--resimulate"), re.MULTILINE)


def test_a_sweep_takes_keys_by_the_page_s_names(page, tmp_path):
    table = tmp_path / "sweep.csv"
    answer(
        "study", page, "sweep", "--over", "springs.spring.rate_n_per_m=7000,9000", "--duration", "0.3",
        "--out", table, "--no-picture", "--cores", "1",
    )  # fmt: skip
    rows = table.read_text(encoding="utf-8").splitlines()
    assert len(rows) == 3
    assert "springs.spring.rate_n_per_m" in rows[0]
    assert rows[1] != rows[2]


def test_a_page_that_is_not_there_is_told(tmp_path):
    with pytest.raises(ConfigurationError, match="no such page"):
        answer("simulate", tmp_path / "nothing.yaml", "--duration", "1")


def test_a_fault_of_a_page_names_file_and_element(page):
    page.write_text(page.read_text(encoding="utf-8").replace("rod.end", "rod.tip"), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"my\.yaml: joints\.wrist\.between: rod has no point 'tip'"):
        answer("check", page)


def test_a_page_is_compared_with_a_bag_of_it(page, tmp_path):
    bag = tmp_path / "bag"
    answer("simulate", page, "--duration", "0.3", "--bag", bag)
    found = json.loads(answer("compare", page, bag, "--duration", "0.3", "--json"))
    assert found
    told = RUNNER.invoke(app, ["compare", str(page), str(bag), "--duration", "0.3"])
    assert (told.exit_code, told.output.splitlines()[0]) == (0, "spring_hammer")


def test_a_map_of_a_page_is_of_every_path_of_it(page, tmp_path):
    bag, chart = tmp_path / "bag", tmp_path / "map.yaml"
    answer("simulate", page, "--duration", "0.3", "--bag", bag)
    answer("map", bag, page, "--out", chart)
    with pytest.raises(CommandError, match=r"no complete cycle of linkage\.crank_bearing\.position after 2 s"):
        answer("monitor", page, bag, "--map", chart, "--baseline", bag)


def test_what_is_refused_of_a_page_names_it(page, tmp_path):
    (tmp_path / "plant.csv").write_text("t,u,v\n" + "".join(f"{i},{i},{-i}\n" for i in range(20)), encoding="utf-8")
    with pytest.raises(CommandError, match="none of its channels has a name of spring_hammer; they are 'u', 'v'"):
        answer("map", tmp_path / "plant.csv", page)
    for study in (lambda: studies.synthesise(str(page), 1.0), lambda: studies.reproduce(str(page))):
        with pytest.raises(StudyError, match=r"my\.yaml: no "):
            study()


@pytest.mark.parametrize("mode", [(), ("--resimulate",)])
def test_a_page_where_a_recording_is_expected_is_told_apart(page, mode):
    with pytest.raises(CommandError, match="expected a recording, not a page"):
        answer("replay", page, *mode)


def test_info_of_a_page_names_the_verb_that_describes_it(page):
    with pytest.raises(CommandError, match="`mech-twin check` describes a page"):
        answer("info", page)


@pytest.mark.slow
def test_view_of_a_page_shows_its_run(page, tmp_path):
    file = tmp_path / "shown.rrd"
    answer("view", page, "--duration", "0.2", "--save", file)
    moving, _ = rrd_tables(file)
    sliding = np.array(moving["/linkage_sliding/position"]["Scalars:scalars"].to_pylist())
    assert (np.ptp(sliding, axis=0) > 0.01).all()
    assert len(moving["/mechanism/figure"]) > 5
    ends = moving["/mechanism/figure"]["sim_time"].to_pylist()[-1]
    assert ends.total_seconds() == pytest.approx(0.2), "the last frame is drawn too"
    still = tmp_path / "still.rrd"
    answer("view", page, "--duration", "0", "--save", still)
    assert len(rrd_tables(still)[0]["/mechanism/figure"]) == 1
    with pytest.raises(CommandError, match=r"--duration 1: a recording has its own length; expected a page"):
        answer("view", tmp_path, "--duration", "1")


def test_a_page_is_followed_under_its_own_name(page):
    with pytest.raises(ConfigurationError, match="/spring_hammer/twin is the shadow's own"):
        answer("shadow", page, "--from", "/spring_hammer/twin")
    with pytest.raises(CommandError, match=r"--uncertain bodies\.ram\.mass=2%: the machine has no key"):
        answer("shadow", page, "--from", "/plant", "--uncertain", "bodies.ram.mass=2%")


@pytest.mark.parametrize(
    ("question", "reason"),
    [("size", "leads every joint; this page has 1 free"), ("search", "its runs are searched with --objective")],
)
def test_questions_that_a_page_does_not_answer_are_refused_by_name(page, question, reason):
    with pytest.raises(StudyError, match=reason):
        answer("study", page, question)


@pytest.mark.slow
def test_a_search_by_runs_finds_the_length_that_a_limit_allows(tmp_path):
    """At its far dead point a slider-crank reaches r + l, and at its near one l - r."""
    page, found = tmp_path / "my.yaml", tmp_path / "found.yaml"
    page.write_text(answer("new", "slider_crank"), encoding="utf-8")
    words = ["--bound", "bodies.crank.points_m.pin.0=0.03:0.08", "--duration", "0.2", "--cores", "1", "--json"]
    limit = ["--limit", "guide_min_m=0.14:"]
    told = answer("study", page, "search", "--objective", "-guide_max_m", *limit, *words, "--out", found)
    (best,) = json.loads(told[told.index("{") :])["designs"]
    assert best["bodies.crank.points_m.pin.0"] == pytest.approx(0.06, rel=2e-3)
    assert best["guide_max_m"] == pytest.approx(0.26, rel=1e-3)
    assert 0.0 <= best["margins"]["guide_min_m >= 0.14"] < 2e-4
    assert machine_parameters(str(found)).bodies["crank"].points_m["pin"][0] == best["bodies.crank.points_m.pin.0"]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--objective", "no_number", "--bound", "bodies.ram.mass_kg=3:6"), "objective 'no_number'|no objective"),
        (("--objective", "total_mass_kg", "--bound", "bodies.ram.masses=3:6"), "no configuration key"),
        (("--objective", "total_mass_kg", "--bound", "bodies.ram.mass_kg=6"), "6 < 6 fails"),
        (
            ("--objective", "total_mass_kg", "--bound", "bodies.ram.mass_kg=3:6", "--limit", "total_mass_kg=:1"),
            "found no design that keeps every limit; the nearest, bodies.ram.mass_kg = 3",
        ),
    ],
)
def test_a_search_by_runs_names_what_is_wrong_with_it(page, words, told):
    with pytest.raises(StudyError, match=told):
        answer("study", page, "search", *words, "--cores", "1")


def test_a_flywheel_is_written_into_the_page(tmp_path):
    page, sized = tmp_path / "my.yaml", tmp_path / "sized.yaml"
    page.write_text(answer("new", "quick_return"), encoding="utf-8")
    found = json.loads(answer("study", page, "size", "--limit", "non_uniformity=0.1", "--out", sized, "--json"))
    flywheel = found["metrics"]["flywheel_inertia_kg_m2"]
    assert found["sizes"] == {"bodies.crank.inertia_kg_m2": pytest.approx(0.2 + flywheel)}
    before, after = machine_parameters(str(page)), machine_parameters(str(sized))
    assert after.bodies["crank"].inertia_kg_m2 == pytest.approx(0.2 + flywheel)
    assert after.bodies["ram"] == before.bodies["ram"]
    assert "# was 0.2;" in sized.read_text(encoding="utf-8")
    assert "the slow stroke runs to the left" in sized.read_text(encoding="utf-8")
    again = json.loads(
        answer("study", sized, "size", "--limit", "non_uniformity=0.1", "--out", page, "--force", "--json")
    )
    assert again["metrics"]["flywheel_inertia_kg_m2"] == pytest.approx(0.0, abs=1e-6 * flywheel)


@pytest.mark.slow
def test_a_length_of_the_page_is_swept_as_a_number_of_its_point(page, tmp_path):
    table = tmp_path / "sweep.csv"
    words = ("--duration", "0.2", "--out", table, "--no-picture", "--cores", "1", "--force")
    answer("study", page, "sweep", "--over", "bodies.crank.points_m.pin.0=0.03,0.04", *words)
    rows = table.read_text(encoding="utf-8").splitlines()
    assert len(rows) == 3
    assert rows[1].split(",")[1:] != rows[2].split(",")[1:]
    with pytest.raises(StudyError, match=r"no configuration key 'bodies\.crank\.points_m\.pin\.2'"):
        answer("study", page, "sweep", "--over", "bodies.crank.points_m.pin.2=0.03,0.04", *words)
    assert machine_parameters(str(page), None, {"gravity_m_per_s2.1": -1.6}).gravity_m_per_s2 == (0.0, -1.6)


def test_a_page_without_its_file_is_asked_for_it():
    """A map of a page names the machine `page`, which has no installed configuration."""
    with pytest.raises(ConfigurationError, match="expected its own, as --config FILE"):
        machine_parameters("page")


def test_a_configuration_given_as_a_page_is_refused_with_the_words_that_take_it(tmp_path):
    file = tmp_path / "sized.yaml"
    file.write_text("/**: {ros__parameters: {machine: mb10_breaker}}", encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"'mb10_breaker': expected 'page'; `mb10_breaker --config FILE`"):
        answer("simulate", file, "--duration", "1")


def test_a_picture_without_a_known_ending_overwrites_nothing(page, tmp_path):
    for name in ("keep", "keep.bmp"):
        with pytest.raises(OutputError, match=r"expected a name that ends in \.png or \.svg"):
            answer("check", page, "--picture", tmp_path / name)
    assert [file.name for file in tmp_path.iterdir()] == [page.name]


def test_a_change_after_the_end_is_refused(page):
    key = next(iter(yaml.safe_load(page.read_text(encoding="utf-8"))["springs"]))
    with pytest.raises(ConfigurationError, match=r"expected before the end at 0\.1 s"):
        answer("simulate", page, "--duration", "0.1", "--change", f"springs.{key}.rate_n_per_m=5000@0.1")


def test_a_page_that_lacks_one_of_its_groups_is_told_which(page):
    page.write_text(page.read_text(encoding="utf-8").replace("bodies:", "body:"), encoding="utf-8")
    with pytest.raises(
        ConfigurationError, match=r"key 'bodies' is missing; unknown group 'body'.*did you mean 'bodies'"
    ):
        answer("check", page)


def test_an_angle_is_not_taken_for_the_travel_of_a_slider(page, tmp_path):
    file = tmp_path / "slides.yaml"
    joints = "joints: {s: {kind: slider, between: [ground, m]}}"
    file.write_text(f"bodies: {{m: {{mass_kg: 1}}}}\n{joints}\n", encoding="utf-8")
    with pytest.raises(StudyError, match="no turning joint"):
        answer("analyse", file, "--crank-deg", "40")


def test_the_keys_of_a_group_are_told_with_unit_and_meaning():
    told = answer("new", "--keys", "springs")
    assert re.search(r"springs\.NAME\.rate_n_per_m +N/m +rate of a spring", told)
    assert "dampers" not in told
    with pytest.raises(CommandError, match=r"--keys sprngs: expected all or one of .*springs"):
        answer("new", "--keys", "sprngs")


@pytest.mark.slow
def test_a_point_of_a_page_is_identified_and_written_into_the_folder(tmp_path):
    sensors = """machine: page
time: {column: t}
channels:
  - {source: {column: w}, is: linkage.crank_bearing.position, rate_hz: 500, sigma: 0.001}
  - {source: {column: p}, is: linkage.guide.position, rate_hz: 400, sigma: 1.0e-4}
"""
    page, told, key = tmp_path / "my.yaml", tmp_path / "sensors.yaml", "bodies.crank.points_m.pin.0"
    page.write_text(answer("new", "slider_crank"), encoding="utf-8")
    told.write_text(sensors, encoding="utf-8")
    run, found = tmp_path / "run.csv", tmp_path / "found"
    answer(
        "simulate", page, "--duration", "2", "--one-step", "--sensors", told, "--table", run, "--set", f"{key}=0.053"
    )
    answer("identify", page, run, "--map", told, "--free", key, "--out", found)
    assert sorted(path.name for path in tmp_path.glob("*.yaml")) == ["my.yaml", "sensors.yaml"]
    text = (found / "my.yaml").read_text(encoding="utf-8")
    assert machine_parameters(str(found / "my.yaml")).bodies["crank"].points_m["pin"][0] == pytest.approx(
        0.053, abs=2e-5
    )
    assert re.search(r"- 0\.05\d+  # identified 0\.05", text)
    with pytest.raises(ConfigurationError, match=r"pin\.2: expected a key of .* that is a number"):
        answer("identify", page, run, "--map", told, "--free", "bodies.crank.points_m.pin.2")
