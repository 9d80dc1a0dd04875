# SPDX-License-Identifier: Apache-2.0
"""A shadow beside a machine that plays a foreign one: other names, units and clock, hidden parameters, noise."""

from __future__ import annotations

import time
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from bench_run import ShadowBench
from catalogue import PAGES, built
from diagnostic_msgs.msg import DiagnosticArray
from rrd_tables import rrd_tables
from sensor_msgs.msg import JointState

from mech_twin.declarations.configuration_tree import (
    ConfigurationError,
    configuration_tree,
    merged_tree,
    tree_from_flat,
)
from mech_twin.engine.rollout import roll_out
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.measurements.units import sliding_in
from mech_twin.messages.cdr import Header, Stamp, StepMessage, encoded, stamp_of
from mech_twin.messages.topics import (
    DATA,
    DIAGNOSTICS,
    ESTIMATED,
    RESIDUALS,
    full_name,
    shadow_topics,
    sigma_of,
    type_name,
    virtual_pin,
)
from mech_twin.nodes.run.domain import NameInUseError
from mech_twin.nodes.run.name_guard import NameGuard
from mech_twin.nodes.shadow.inputs import StampOrigin, own_map, sensed_channels
from mech_twin.nodes.shadow.session import Company, followed_namespace
from mech_twin.nodes.shadow.shadow_node import FOLLOWED
from mech_twin.nodes.shadow.viewer_node import ShadowState, channel_title, shown_cards, state_line
from mech_twin.parameters.load import catalogue_entry
from mech_twin.recording.bag_reader import open_bag
from mech_twin.studies.monitoring.findings import FaultLife

pytestmark = pytest.mark.usefixtures("ros_domain")
NAME = "vibration_crank"
WHEEL = {"topic": "wheel", "joint": "main_shaft", "field": "position"}
CHANNEL = {"source": WHEEL, "is": "linkage.crank.position", "unit": "deg", "zero": 30.0, "sign": -1, "sigma": 0.05}
MAP = MeasurementMap.model_validate({"machine": NAME, "channels": [CHANNEL]})
HIDDEN = {"masses.boom_kg": 34.0, "drive.speed_rpm": 151.0}
EPOCH_S = 1.7e9
RATE_HZ = 100.0


class FollowedMachine(ShadowBench):
    """A foreign publisher of a machine's wheel, a shadow beside it, and a witness of all that is said."""

    def __init__(self, directory: Path | None = None, silence_s: float = 1000.0, view: Path | None = None) -> None:
        tree = merged_tree(configuration_tree(built(NAME).parameters), tree_from_flat(HIDDEN))
        entry = catalogue_entry(NAME)
        self.run = roll_out(entry.build(entry.parameters.model_validate(tree)), 2.5)
        company = Company(directory, view=None if view is None else str(view))
        super().__init__(NAME, MAP, company, peer_timeout_s=silence_s)
        self.wheel = self.client.create_publisher(JointState, "wheel", DATA)
        self.heard: dict[str, list[Any]] = {}
        self.random = np.random.default_rng(5)

    def listen(self, name: str, kind: Any) -> list[Any]:
        heard = self.heard[name] = []
        self.client.create_subscription(kind, name, heard.append, DATA)
        self.until(lambda: self.client.count_publishers(name) > 0)
        return heard

    def show(self, row: int, shift_s: float = 0.0) -> None:
        """Publish what the wheel shows at a row of the run."""
        crank = -np.degrees(self.run["linkage.crank.position"][row]) + 30.0 + 0.05 * self.random.standard_normal()
        header = Header(stamp_of(EPOCH_S + shift_s + float(self.run["time_s"][row])))
        self.wheel.publish(encoded(StepMessage(header, ("main_shaft",), (float(crank),), (0.0,), (0.0,))))

    def stray(self, second: int) -> None:
        """Publish what somebody else may: a message of the wheel's with a stamp of its own."""
        header = Header(Stamp(second, 0))
        self.wheel.publish(encoded(StepMessage(header, ("main_shaft",), (0.0,), (0.0,), (0.0,))))

    def play(self, rows: range) -> None:
        """Publish rows one after the other, each when the one before has been taken."""
        counts = self.shadow.observer
        for row in rows:
            before = self.taken
            self.show(row)
            self.until(lambda before=before: self.taken > before)  # type: ignore[misc]
        assert counts.channels

    @property
    def taken(self) -> int:
        observer = self.shadow.observer
        return (
            len(self.shadow.admission.held)
            + len(observer._waiting)
            + sum(output.sent for output in self.shadow.outputs if output.name == ESTIMATED.name)
        )

    def __enter__(self) -> FollowedMachine:
        self.until(lambda: self.wheel.get_subscription_count() >= 1)
        return self


ROWS = range(400, 1400, round(1000 / RATE_HZ))


def test_a_foreign_machine_with_hidden_parameters_is_followed(tmp_path: Path) -> None:
    with FollowedMachine(tmp_path / "bag") as bench:
        estimated = bench.listen(full_name(NAME, ESTIMATED), JointState)
        sigma = bench.listen(full_name(NAME, sigma_of(ESTIMATED)), JointState)
        residuals = bench.listen(full_name(NAME, RESIDUALS), JointState)
        pin = bench.listen(full_name(NAME, virtual_pin("crank_pin")), virtual_pin("any").type)
        pin_sigma = bench.listen(full_name(NAME, sigma_of(virtual_pin("crank_pin"))), virtual_pin("any").type)
        bench.play(ROWS)
        bench.until(lambda: len(pin_sigma) > 50 and len(residuals) == len(estimated) == len(sigma))
        published = dict(bench.client.get_publisher_names_and_types_by_node("shadow", f"/{NAME}"))
        bench.spinner.until(lambda: bench.nodes[1].received.get(full_name(NAME, ESTIMATED), 0) >= len(estimated))
    assert not [name for name in published if name.startswith("/plant")]
    stamps = [message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec - EPOCH_S for message in estimated[20:]]
    rows = np.rint(np.array(stamps) / built(NAME).coupling_step_s).astype(int)
    place = list(estimated[0].name).index("slider")
    true = bench.run["linkage.slider.position"][rows]
    inside = [
        abs(message.position[place] - value) <= 2.0 * deviation.position[place]
        for message, deviation, value in zip(estimated[20:], sigma[20:], true, strict=True)
    ]
    assert np.mean(inside) >= 0.9
    force = bench.run["forces.crank_pin.force_y_n"]
    late = list(zip(pin, pin_sigma, strict=False))[20:]
    steps = [round((m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec - EPOCH_S) * 1e3) for m, _ in late]
    close = [
        abs(m.wrench.force.y - force[step]) <= 2.0 * s.wrench.force.y for (m, s), step in zip(late, steps, strict=True)
    ]
    assert np.mean(close) >= 0.9
    assert residuals[-1].name == ["crank"]
    assert abs(residuals[-1].position[0]) < 0.01
    with open_bag(tmp_path / "bag") as reader:
        counts = {name: about.message_count for name, about in reader.topics.items()}
    assert counts[full_name(NAME, ESTIMATED)] == len(estimated)
    assert counts["/plant/wheel"] == len(ROWS)


def test_the_view_shows_measured_and_model_with_the_residual_in_its_band_and_the_state(tmp_path: Path) -> None:
    with FollowedMachine(view=tmp_path / "seen.rrd") as bench:
        bench.play(ROWS)
        estimates = len(ROWS) - len(bench.shadow.observer._waiting)
    moving, static = rrd_tables(tmp_path / "seen.rrd")
    curves = moving[f"/channels/{CHANNEL['is']}"]
    times_s = np.array(curves["sim_time"].cast(pa.int64()).to_pylist()) * 1e-9
    measured, model = np.array(curves["Scalars:scalars"].to_pylist()).T
    residual, above, below = np.array(moving[f"/residuals/{CHANNEL['is']}"]["Scalars:scalars"].to_pylist()).T
    assert 0.3 * estimates < len(measured) <= estimates
    true = np.interp(times_s, bench.run["time_s"] + EPOCH_S - bench.shadow.origin.second, bench.run[CHANNEL["is"]])
    assert np.abs(measured - true).max() < np.radians(6.0 * 0.05)  # six sigma of the noise that was added
    assert np.abs(model - true).max() < 0.05
    assert np.array_equal(above, -below)
    assert above.min() > 0.0
    assert np.mean(np.abs(residual[len(residual) // 5 :]) <= above[len(residual) // 5 :]) >= 0.9
    figures = moving["/mechanism/figure"]
    drawn = built(NAME).draw(built(NAME).linkage.start(), None)
    lines = sum(shape.kind == "line" for shape in drawn)
    assert len(figures["LineStrips2D:strips"].to_pylist()[-1]) >= 2 * lines, "model and measurement are not both drawn"
    words = moving["/banner"]["TextDocument:text"].to_pylist()[-1][0]
    assert "**locked**" in words
    assert "no monitor" in words
    assert static["/channels/linkage.crank.position"].column("SeriesLines:names").to_pylist()[0] == [
        "measured",
        "model",
    ]


def test_a_channel_of_a_joint_that_slides_is_in_metres_whatever_its_name() -> None:
    sliding = sliding_in(built(next(page for page in PAGES if page.endswith("quick_return.yaml"))))
    assert channel_title("linkage.ram_guide.position", sliding) == "ram guide position, m"
    assert channel_title("linkage.ram_guide.effort", sliding) == "ram guide effort, N"
    assert channel_title("linkage.lever_pivot.velocity", sliding) == "lever pivot velocity, rad/s"
    assert channel_title("linkage.slider.velocity", sliding_in(built("vibration_crank"))) == "slider velocity, m/s"


def test_the_line_of_state_names_what_the_operator_must_see() -> None:
    faults = tuple(FaultLife(f"fault {state}", state) for state in ("cleared", "pending", "active", "latched"))
    line = state_line(ShadowState("locked", "shadow", 12.5, 0.42, faults))
    assert "FAULT fault active: active" in line
    assert "FAULT fault latched: latched" in line
    assert "cleared" not in line
    assert "t = 12.50 s" in line
    assert "residual 0.4 sigma" in line
    assert "no fault" in state_line(ShadowState("locked", "shadow", 1.0, 0.0, faults[:1]))
    silent = state_line(ShadowState("waiting: STALE, nothing from the machine for 2.0 s", "model", None, 0.0, None))
    assert "STALE" in silent
    assert "no monitor" in silent


def test_a_page_whose_times_are_not_of_the_machines_clock_tells_where_they_begin() -> None:
    origin, state = StampOrigin(), ShadowState("locked", "shadow", 1.5, 0.0, None)
    origin.seconds(Stamp(1_800_000_009, 500_000_000))
    assert shown_cards(state, origin)[-1].shown == "1800000009 s"
    assert len(shown_cards(state, StampOrigin())) == 2


@pytest.mark.slow
def test_silence_is_said_and_estimates_are_held_with_growing_sigma() -> None:
    with FollowedMachine(silence_s=0.4) as bench:
        sigma = bench.listen(full_name(NAME, sigma_of(ESTIMATED)), JointState)
        estimated = bench.listen(full_name(NAME, ESTIMATED), JointState)
        said = bench.listen(DIAGNOSTICS.name, DiagnosticArray)
        bench.play(ROWS)
        bench.until(lambda: len(estimated) > 20 and len(sigma) == len(estimated))
        measured = min(message.position[0] for message in sigma)
        bench.until(lambda: any("STALE" in s.message for array in said for s in array.status))
        last = len(sigma)
        bench.until(lambda: len(sigma) >= last + 3 and len(estimated) >= last + 3)
        stale = next(s for array in said for s in array.status if "STALE" in s.message)
        values = {v.key: v.value for v in stale.values}
        held, grown = estimated[last : last + 3], [message.position[0] for message in sigma[last : last + 3]]
        bench.show(ROWS[-1] + 10)
        bench.until(lambda: bench.shadow.diagnostics.state != "" and not bench.shadow._stale)
    assert all(message.position == held[0].position and message.header == held[0].header for message in held)
    assert grown[0] > 100.0 * measured
    assert all(later >= earlier for earlier, later in pairwise(grown))
    assert values["level"] == "model"
    assert int(values["/plant/wheel: timeout"]) >= 1


def test_the_latency_of_an_estimate_counts_the_wait_of_its_sample_and_is_told_where_it_is_too_long() -> None:
    with FollowedMachine(silence_s=0.4) as bench:
        bench.play(ROWS[:60])
        bench.shadow._latencies_s.clear()
        before = bench.shadow.statistics.total["/plant/wheel", "suspended"]
        for row in ROWS[60:70]:
            bench.show(row)
        time.sleep(0.5)
        bench.until(lambda: len(bench.shadow._latencies_s) == 10)
        told = bench.shadow.diagnostic_values()["latency median ms"]
        assert bench.shadow.statistics.total["/plant/wheel", "suspended"] > before
        waited_s = partial(bench.shadow._waited_s, "another")
        assert [waited_s(10.0, 100.0), waited_s(10.5, 100.1)] == [0.0, pytest.approx(0.4)]
        set_back = [waited_s(10.6, 50.0), waited_s(10.7, 50.1)]  # the clock of the middleware
        assert set_back == [pytest.approx(0.4)] * 2
        assert waited_s(10.8, 90.0) == 0.0
    assert 450.0 < float(told) < 5000.0


def test_messages_that_are_not_taken_in_time_are_counted() -> None:
    with FollowedMachine() as bench:
        bench.play(ROWS[:2])
        for _ in range(FOLLOWED.depth + 100):
            bench.show(ROWS[2])
        time.sleep(0.5)  # all have arrived, and the oldest have given place
        bench.show(ROWS[3])
        bench.until(lambda: bench.shadow.statistics.total["/plant/wheel", "missing"] > 0)
        assert bench.shadow.statistics.total["/plant/wheel", "missing"] == 101


def test_garbage_on_a_followed_topic_is_counted_and_changes_nothing() -> None:
    with FollowedMachine() as bench:
        bench.play(ROWS[:60])
        before = bench.shadow.estimate
        header = Header(stamp_of(EPOCH_S + 1.0))
        bench.wheel.publish(b"\x00\x01\x00\x00 no message")
        bench.wheel.publish(encoded(StepMessage(header, ("main_shaft",), (float("nan"),), (0.0,), (0.0,))))
        bench.wheel.publish(encoded(StepMessage(header, ("another",), (1.0,), (0.0,), (0.0,))))
        bench.until(lambda: bench.shadow.statistics.total["/plant/wheel", "malformed"] == 2)
        assert bench.shadow.estimate is before


STRAYS_S = (round(EPOCH_S) + 86400, 2**31 - 1, 0, 3600, -5, -(2**31))


def test_no_single_stamp_of_somebody_else_leads_a_shadow_or_its_recording(tmp_path: Path) -> None:
    """Among them the very first: all are counted, recorded at the machine's time, and change nothing."""
    with FollowedMachine(tmp_path / "bag") as bench:
        bench.stray(STRAYS_S[0])
        bench.until(lambda: all(len(node.admission.held) >= 1 for node in bench.nodes))  # type: ignore[attr-defined]
        for row in ROWS[:3]:
            bench.show(row)
        bench.until(lambda: len(bench.shadow.observer._waiting) == 3)
        bench.play(ROWS[3:40])
        for place, second in enumerate(STRAYS_S[1:]):
            bench.stray(second)
            bench.play(ROWS[40 + 5 * place : 45 + 5 * place])
            assert bench.shadow.observer.state.value == "locked"
        observer, recorder = bench.shadow.observer, bench.nodes[1]
        bench.until(lambda: recorder.received["/plant/wheel"] >= 65 + len(STRAYS_S))
        for node in (bench.shadow, recorder):
            assert node.statistics.total["/plant/wheel", "unknown_source"] == len(STRAYS_S)
        assert observer.state.value == "locked"
        assert observer.counts["jump"] == observer.counts["lost"] == 0
        assert bench.shadow.origin.second == round(EPOCH_S)
        first_s, last_s = (EPOCH_S + float(bench.run["time_s"][ROWS[i]]) for i in (0, 64))
    with open_bag(tmp_path / "bag") as reader:
        assert reader.start_ns is not None
        assert reader.end_ns is not None
        assert reader.start_ns >= round(first_s * 1e9) - 1000
        assert reader.end_ns <= round(last_s * 1e9) + 1000
        assert all(row["missed"] == 0 for row in reader.info.counters.values())


def test_a_machine_started_anew_is_followed_and_recorded_at_its_new_time(tmp_path: Path) -> None:
    with FollowedMachine(tmp_path / "bag") as bench:
        bench.play(ROWS[:40])
        begun_anew = []
        bench.shadow.at_other_time.append(lambda: begun_anew.append(bench.shadow.observer.state))
        recorder = bench.nodes[1]
        for i, row in enumerate(ROWS[:40]):
            bench.show(row, shift_s=-EPOCH_S)
            bench.until(lambda i=i: recorder.received["/plant/wheel"] > 40 + i)  # type: ignore[misc]
        bench.until(lambda: bench.shadow.observer.state.value == "locked")
        assert len(begun_anew) == 1
        assert recorder.newest_s == pytest.approx(float(bench.run["time_s"][ROWS[39]]), abs=1e-6)  # type: ignore[attr-defined]


def test_a_second_shadow_of_a_machine_refuses_to_start() -> None:
    with FollowedMachine() as bench, NameGuard([full_name(NAME, ESTIMATED)]) as guard:
        bench.play(ROWS[:40])
        with pytest.raises(NameInUseError, match="twin/estimated/joint_states"):
            bench.spinner.until(lambda: _checked(guard, bench))


def _checked(guard: NameGuard, bench: FollowedMachine) -> bool:
    bench.shadow.report()
    guard.check()
    return False


def test_a_shadow_never_follows_itself() -> None:
    with pytest.raises(ConfigurationError, match="the shadow's own"):
        followed_namespace(NAME, f"{NAME}/twin")
    with pytest.raises(ConfigurationError, match="--from plant/: expected letters"):
        followed_namespace(NAME, "plant/")


@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_followed_by_the_joint_that_leads_it_even_where_its_drive_prescribes_it(page: str) -> None:
    machine = built(page)
    assert machine.mechanism is not None
    followed = {channel.quantity for channel in own_map(machine).channels}
    joints = {*machine.linkage.coordinates, machine.mechanism.leading}
    assert followed == {f"linkage.{joint}.position" for joint in joints}


def test_what_a_map_does_not_know_is_asked_for() -> None:
    unknown = MeasurementMap.model_validate({"machine": NAME, "channels": [{**CHANNEL, "zero": "per_run"}]})
    with pytest.raises(ConfigurationError, match=r"key 'channels.0.zero', value 'per_run': expected a number"):
        sensed_channels(unknown)


def test_every_topic_of_a_shadow_is_on_the_page() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "topics.md").read_text(encoding="utf-8")
    section = page.split("\n## Topics of a shadow\n")[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| `twin/")]
    promised = {line.split("`")[1]: line.split("|")[2].strip().removesuffix(", latched") for line in rows}
    machine = built("mb10_breaker")
    for topic in shadow_topics(machine.forces.pins, has_body=True):
        pin = next((pin for pin in machine.forces.pins if topic.name.startswith(virtual_pin(pin).name)), None)
        name = topic.name.replace(f"/{pin}", "/<pin>") if pin else topic.name
        name = name.removesuffix("/sigma")
        assert promised.get(name) == type_name(topic).replace("/msg/", "/"), name
    assert len(promised) == 9
