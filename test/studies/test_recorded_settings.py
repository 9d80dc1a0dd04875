# SPDX-License-Identifier: Apache-2.0
"""Of a recording's configuration what is not as installed is told, and nothing of one that cannot be read."""

from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.resimulation import recorded_settings

NAME = "compaction_press"


def test_what_a_recording_has_that_is_not_as_installed_is_told_with_both_values():
    changed = machine_parameters(NAME, None, {"working_force.peak_n": 20000.0})
    differing = [["working_force.peak_n", "10000.0", "20000.0"]]
    assert recorded_settings([description_text(NAME, changed)]) == (NAME, differing)
    assert recorded_settings([description_text(NAME, machine_parameters(NAME))]) == (NAME, [])


def test_nothing_is_told_of_a_recording_without_a_configuration_that_validates():
    assert recorded_settings([]) == ("", [])
    assert recorded_settings(["machine: nothing_known"]) == ("", [])
