# SPDX-License-Identifier: Apache-2.0
"""The text of a proposed map: it fits a terminal, and what is read of it is what was proposed."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from catalogue import built

from mech_twin.measurements.blocks import SourceColumn
from mech_twin.measurements.measurement_map import Source, TimeSource
from mech_twin.measurements.proposal import MOST_LEFT_OUT, UNSURE, WIDTH, map_text, proposed_channels, unknown_unit
from mech_twin.measurements.units import UNITS, machine_columns, unit_in

FOREIGN = {  # headers of other people's tables, and what they are
    "mb10_breaker": {"Motor speed [rpm]": "motor.rotor.velocity", "Hammer angle (deg)": "linkage.rocker.position"},
    "compaction_press": {
        "Main shaft speed (1/min)": "linkage.crank.velocity",
        "pendulum_deg": "linkage.pendulum.position",
    },
    "vibration_crank": {"Encoder (°)": "linkage.crank.position", "Tree displacement [cm]": "linkage.slider.position"},
    "impact_mass": {"Striker travel (mm)": "linkage.mass.position", "Force (kN)": "motor.generator.effort"},
    "roller_former": {"Carriage 2 travel (mm)": "linkage.cart_2.position", "Current (A)": "motor.rotor.effort"},
    "winding_drum": {"Bobbin speed (rpm)": "linkage.drum.velocity", "Yarn speed (m/min)": "linkage.yarn.velocity"},
}
LONG = "/plant/line_3/machine_17/encoder_of_the_main_shaft"
OFFERED = (
    SourceColumn(Source(topic=LONG, joint="main_shaft", field="position"), "deg"),
    SourceColumn(Source(topic="/plant/slide", joint="ram", field="velocity"), None),
    SourceColumn(Source(topic="/plant/slide", joint="ramp_up", field="velocity"), None),
    SourceColumn(Source(column="Wheel (deg)"), "deg"),
    SourceColumn(Source(column="Torque"), None),
)


@pytest.mark.parametrize("machine", ["vibration_crank", "compaction_press"])
def test_a_proposed_map_fits_a_terminal_and_reads_as_proposed(machine: str) -> None:
    columns = machine_columns(built(machine))
    channels = proposed_channels(OFFERED, columns)
    labels = [each.source.label for each in channels]
    notes = dict.fromkeys(labels, "correlation 0.987 with the model, crank zero 0.123 rad, over all of its turns")
    text = map_text(machine, TimeSource(), channels, notes, columns)
    assert [line for line in text.splitlines() if len(line) > WIDTH] == []
    sure = [each for each in channels if each.surety > UNSURE]
    assert sure
    read = yaml.safe_load(text)["channels"]
    assert [channel["source"] for channel in read] == [each.source.model_dump(exclude_none=True) for each in sure]
    assert [channel["is"] for channel in read] == [each.column for each in sure]
    unsure = "\n".join(f"  {line[4:]}" if line.startswith("  # ") else line for line in text.splitlines())
    assert len(yaml.safe_load(unsure)["channels"]) == len(channels)  # taking the comment away is all it needs


@pytest.mark.parametrize(
    ("header", "unit", "factor"),
    [
        ("Crank torque [kNm]", "kN.m", 1e3),
        ("Crank torque (N·mm)", "N.mm", 1e-3),
        ("Crank speed [Hz]", "turn/s", 2.0 * np.pi),
        ("Crank angle [mrad]", "mrad", 1e-3),
        ("Drive power [kW]", "kW", 1e3),
    ],
)
def test_a_unit_in_a_header_is_read_with_its_size(header: str, unit: str, factor: float) -> None:
    assert unit_in(header) == unit
    assert UNITS[unit].factor == pytest.approx(factor)


def test_a_unit_that_no_map_knows_is_named_beside_the_one_assumed() -> None:
    offered = [SourceColumn(Source(column=name), None) for name in ("Slider position [inch]", "Crank angle")]
    columns = machine_columns(built("vibration_crank"))
    foreign, plain = proposed_channels(offered, columns)
    text = map_text("vibration_crank", TimeSource(), [foreign, plain], {}, columns)
    assert "# unit: 'inch' is no unit of a map; m is assumed" in text
    assert (unknown_unit(foreign) is not None, unknown_unit(plain)) == (True, None)
    weeks = map_text("vibration_crank", TimeSource(column="Time [weeks]"), [plain], {}, columns)
    assert "# unit: 'weeks' is no unit of a map; s is assumed" in weeks and yaml.safe_load(weeks)["time"]


@pytest.mark.parametrize("pin", ["follower_pin", "crank_pin", "crank_bearing"])
def test_a_wrench_below_the_name_of_a_pin_is_the_force_at_that_pin(pin: str) -> None:
    fields = {"wrench.force.x": "force_x_n", "wrench.force.y": "force_y_n", "wrench.torque.z": "moment_nm"}
    offered = [SourceColumn(Source(topic=f"/plant/cell/{pin}", field=field), None) for field in fields]
    found = proposed_channels(offered, machine_columns(built("vibration_crank")))
    assert [each.column for each in found] == [f"forces.{pin}.{component}" for component in fields.values()]
    assert min(each.surety for each in found) > UNSURE


@pytest.mark.parametrize("strange", [1, MOST_LEFT_OUT, 40])
def test_a_channel_that_is_offered_stands_in_the_map_or_is_named_as_left_out(strange: int) -> None:
    offered = [*OFFERED, *(SourceColumn(Source(column=f"Druck {place} [bar]"), None) for place in range(strange))]
    columns = machine_columns(built("vibration_crank"))
    channels = proposed_channels(offered, columns)
    text = map_text("vibration_crank", TimeSource(), channels, {}, columns, offered=[each.source for each in offered])
    assert yaml.safe_load(text) == yaml.safe_load(map_text("vibration_crank", TimeSource(), channels, {}, columns))
    assert [line for line in text.splitlines() if len(line) > WIDTH] == []
    words = " ".join(text.replace("\n# ", " ").split())
    mapped = {each.source.label for each in channels}
    left_out = [each.source.label for each in offered if each.source.label not in mapped]
    assert all(label in words for label in left_out[:MOST_LEFT_OUT])
    assert (f"and {len(left_out) - MOST_LEFT_OUT} more" in words) == (len(left_out) > MOST_LEFT_OUT)


@pytest.mark.parametrize("machine", FOREIGN)
def test_headers_of_foreign_tables_tell_column_and_unit(machine: str) -> None:
    offered = [SourceColumn(Source(column=header), unit_in(header)) for header in FOREIGN[machine]]
    found = proposed_channels(offered, machine_columns(built(machine)))
    assert all(each.unit is not None and each.surety > UNSURE for each in found)
    assert {each.source.label: each.column for each in found} == FOREIGN[machine]


@pytest.mark.parametrize("label", ["Body angle [deg]", "body (deg)", "body.body.position (deg)"])
def test_a_body_of_its_own_is_proposed_before_the_linkage_s(label: str) -> None:
    columns = machine_columns(built("mb10_breaker"))
    (channel,) = proposed_channels([SourceColumn(Source(column=label), "deg")], columns)
    assert channel.column == "body.body.position"  # which features of the breaker's cycle need


def test_a_joint_of_several_words_is_found_by_all_of_them() -> None:
    columns = {f"linkage.{joint}.position": "rad" for joint in ("crank_bearing", "crank_pin", "wrist_pin")}
    offered = [SourceColumn(Source(column=name), "deg") for name in ("Crank bearing (deg)", "wrist_pin_deg", "pin_deg")]
    found = proposed_channels(offered, columns)
    assert [each.column for each in found] == ["linkage.crank_bearing.position", "linkage.wrist_pin.position"]
    assert all(each.surety > UNSURE for each in found)
