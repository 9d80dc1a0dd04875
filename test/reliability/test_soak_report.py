# SPDX-License-Identifier: Apache-2.0
"""A long run is judged by what it was: nothing that must not be passes, and nothing else is called a fault."""

from __future__ import annotations

from pathlib import Path

import pytest
from catalogue import built
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from footprint import Footprint, FootprintLog
from soak_report import SERVER, Comparison, Told, faults

from mech_twin.messages.topics import STEP_MOTOR, full_name
from mech_twin.parameters.load import machine
from mech_twin.recording.bag_reader import BagReader
from mech_twin.recording.bag_writer import BagWriter

BAG = Path(__file__).resolve().parents[2] / "bags" / "mb10_breaker"
HOUR_S = 3600.0


def watched(role: str, grown_mib_per_min: float, duration_s: float = HOUR_S, jump_mib: float = 0.0) -> FootprintLog:
    """Return looks at a process that takes up memory at first, and then grows steadily."""
    log = FootprintLog()
    for look in range(round(duration_s / 5.0)):
        at_s = 5.0 * look
        memory = 200.0 + jump_mib * (at_s > 300.0) + grown_mib_per_min * at_s / 60.0
        log.rows.setdefault(role, []).append(Footprint(at_s, memory, 10, 20, 0.0))
    return log


def told(**values: str) -> Told:
    told = Told({"energy_balance": 1e-9})
    status = DiagnosticStatus(name="/m/linkage", message="", level=DiagnosticStatus.OK)
    status.values = [KeyValue(key=key.replace("_", " "), value=value) for key, value in values.items()]
    told.hear(HOUR_S, [status])
    return told


@pytest.fixture(scope="module")
def compared() -> Comparison:
    comparison = Comparison()
    comparison.run(BAG, built("mb10_breaker"))
    return comparison


def test_a_sound_hour_has_no_fault(compared: Comparison) -> None:
    assert faults(told(lag_s="0.001"), watched("recorder", 0.1, jump_mib=50.0), compared, True) == []
    assert compared.complete
    assert compared.steps == 2201


@pytest.mark.parametrize("role", ["recorder", SERVER])
def test_growth_after_ten_minutes_is_a_fault(role: str, compared: Comparison) -> None:
    assert faults(told(), watched(role, 0.25), compared, True) == [f"{role} grew by 12.5 MiB"]


def test_a_server_that_fills_its_history_is_no_fault_of_a_short_run(compared: Comparison) -> None:
    assert faults(told(), watched(SERVER, 20.0, 600.0), compared, True) == []
    assert faults(told(), watched("viewer", 20.0, 600.0), compared, True) == ["viewer grew by 148.3 MiB"]


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"given_up_s": "10.2"}, "10.2 s were given up"),
        ({"lag_s": "0.9"}, "behind by up to 0.90 s in 1 windows"),
        ({"step/motor:_timeout": "2"}, "/m/linkage step/motor: timeout: 2"),
    ],
)
def test_what_a_node_said_is_judged(values: dict[str, str], expected: str, compared: Comparison) -> None:
    assert faults(told(**values), watched("linkage", 0.0), compared, True) == [expected]


def test_lag_is_none_of_a_run_at_full_pace(compared: Comparison) -> None:
    assert faults(told(lag_s="0.9"), watched("linkage", 0.0), compared, False) == []


def test_a_recording_of_another_run_differs() -> None:
    comparison = Comparison()
    comparison.run(BAG, machine("mb10_breaker", overrides={"body.spring_rate_n_per_m": 30000.0}))
    assert comparison.first is not None
    assert not comparison.complete
    assert any(line.startswith("not the engine's") for line in faults(told(), FootprintLog(), comparison, True))


def test_a_sample_that_is_not_in_the_recording_is_counted(tmp_path: Path) -> None:
    topic = full_name("mb10_breaker", STEP_MOTOR)
    with BagReader(BAG) as reader, BagWriter(tmp_path / "bag", configuration=reader.info.configuration or "") as writer:
        for name, about in reader.topics.items():
            writer.add_topic(name, about.type_name)
        for number, message in enumerate(reader.messages()):
            if message.topic == topic and 100 <= message.log_time_ns // 1_000_000 < 107:
                continue
            writer.write(message.topic, message.raw, message.log_time_ns, message.publish_time_ns)
            if number > 5000:
                break
    comparison = Comparison()
    comparison.run(tmp_path / "bag", built("mb10_breaker"))
    assert comparison.missing == 7
    assert faults(told(), FootprintLog(), comparison, False) == ["7 samples are not in the recording"]


def test_a_recording_without_a_step_is_a_fault() -> None:
    assert faults(told(), FootprintLog(), Comparison(), False) == ["no step was compared"]
