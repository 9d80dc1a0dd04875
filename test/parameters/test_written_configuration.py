# SPDX-License-Identifier: Apache-2.0
"""A configuration that was chosen is written as the file it came from: with comments, and with what was before."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import catalogue_entry, configuration_file, machine_parameters, text_tree, validated
from mech_twin.parameters.written_configuration import configured_text, write_configuration

# a value of each machine that is not the installed one, one that has no line in the installed file, one left out
CHOSEN = {
    "mb10_breaker": {"body.spring_rate_n_per_m": 41234.5, "body.friction.coulomb_nm": 0.25},
    "compaction_press": {"linkage.crank_m": 0.0553, "links.plate.mass_kg": 41.0},
    "vibration_crank": {"working_force_n": 333.0, "counterweight.mass_kg": None},
    "impact_mass": {"restitution": 0.31},
    "roller_former": {"motor.catalogue_name": "4A160M6U3", "drive.stiffness_nm_per_rad": 120000.0},
    "winding_drum": {"eccentricity_m": 0.0011},
}


def comments(text: str) -> list[str]:
    return [line.partition("#")[2].strip() for line in text.splitlines() if "#" in line]


@pytest.mark.parametrize("name", CATALOGUE)
def test_it_reads_as_the_parameters_and_keeps_every_comment(name: str, tmp_path: Path) -> None:
    chosen = machine_parameters(name, None, CHOSEN[name])
    file = tmp_path / "chosen.yaml"
    write_configuration(name, chosen, file, notes=["mech-twin study", "seed: 3"])
    assert machine_parameters(name, file) == chosen
    text = file.read_text(encoding="utf-8")
    assert text.startswith(f"# {name}, written by mech-twin ")
    assert {"mech-twin study", "seed: 3"} < set(comments(text))
    kept = comments(text)
    for comment in comments(configuration_file(name).read_text(encoding="utf-8")):
        assert any(comment in line for line in kept), comment


def test_what_changed_says_what_it_was(tmp_path: Path) -> None:
    chosen = machine_parameters("compaction_press", None, {"linkage.crank_m": 0.0553})
    text = configured_text("compaction_press", chosen, configuration_file("compaction_press"))
    changed = [line for line in text.splitlines() if "was 0.06" in line]
    assert len(changed) == 1
    assert changed[0].strip().startswith("crank_m: 0.0553")
    assert "assumed: a stroke of 60 mm at mid-plate" in changed[0]
    assert text.count("; ") >= 1
    assert sum("was " in line for line in text.splitlines()) == 1


def test_it_can_be_derived_from_a_file_of_ones_own(tmp_path: Path) -> None:
    """The second study starts from what the first wrote."""
    first, second = tmp_path / "first.yaml", tmp_path / "second.yaml"
    for crank_m, base, out in ((0.05, None, first), (0.045, first, second)):
        parameters = machine_parameters("compaction_press", base, {"linkage.crank_m": crank_m})
        write_configuration("compaction_press", parameters, out, base)
    assert "crank_m: 0.045" in second.read_text(encoding="utf-8")
    assert "was 0.05" in second.read_text(encoding="utf-8")
    assert machine_parameters("compaction_press", second).model_dump()["linkage"]["crank_m"] == 0.045


@pytest.mark.slow
@given(st.floats(0.001, 0.2), st.floats(10.0, 1e5))
def test_every_number_is_written_to_the_last_digit(preload_m: float, rate: float) -> None:
    wanted = {"body.preload_deflection_m": preload_m, "body.spring_rate_n_per_m": rate}
    try:
        chosen = machine_parameters("mb10_breaker", None, wanted)
    except ConfigurationError:
        return
    text = configured_text("mb10_breaker", chosen, configuration_file("mb10_breaker"))
    assert "# published" in text
    assert validated(catalogue_entry("mb10_breaker"), text_tree(text, "text"), "text") == chosen
