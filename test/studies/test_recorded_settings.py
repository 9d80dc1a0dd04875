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


def test_a_setting_that_was_changed_during_the_run_is_told_as_it_was_at_start_and_end():
    """A run that was slowed down while it ran was listed as a machine as installed."""
    of = [machine_parameters(NAME, None, {"drive.speed_rpm": rpm}) for rpm in (300.0, 250.0, 200.0)]
    texts = [description_text(NAME, each, revision, 1000 * revision) for revision, each in enumerate(of)]
    assert recorded_settings(texts) == (NAME, [["drive.speed_rpm", "300.0", "300.0, at the end 200.0"]])
    assert recorded_settings(texts[::2][::-1]) == recorded_settings(texts)


def test_nothing_is_told_of_a_recording_without_a_configuration_that_validates():
    assert recorded_settings([]) == ("", [])
    assert recorded_settings(["machine: nothing_known"]) == ("", [])
