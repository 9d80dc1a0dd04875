# SPDX-License-Identifier: Apache-2.0
"""An advisor beside the twin that plays a machine with hidden parameters, in another process and namespace."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from bench_run import ShadowBench
from builtin_interfaces.msg import Time
from catalogue import built
from command_line import mech_twin
from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Header
from std_srvs.srv import SetBool

from mech_twin.capabilities.variation import varied
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.messages.topics import DATA, DECISIONS, LATCHED, RECOMMENDATION, full_name
from mech_twin.nodes.exchange.spinner import Spinner, destroy_nodes
from mech_twin.nodes.shadow.advisor_node import AdvisorNode
from mech_twin.nodes.shadow.inputs import StampOrigin
from mech_twin.nodes.shadow.session import (
    Company,
    FreeKeys,
    ShadowRecorder,
    follow_setting,
    nodes_beside,
    record_decisions,
)
from mech_twin.nodes.shadow.shadow_node import ShadowNode, ShadowSetup
from mech_twin.studies.advice import AdviceOutput, AdviceWish, Recommendation, offered
from mech_twin.studies.advice_search import COMMAND
from mech_twin.studies.monitoring.cycle_features import FeatureVector

pytestmark = pytest.mark.usefixtures("ros_domain")
NAME = "vibration_crank"
HIDDEN = ("masses.boom_kg=36.0", "masses.extra_kg=9.0")
SOURCE = {"topic": "joint_states", "joint": "crank"}
MAP = MeasurementMap.model_validate(
    {
        "machine": NAME,
        "channels": [
            {"source": {**SOURCE, "field": "position"}, "is": "linkage.crank.position", "sigma": 1e-3},
            {"source": {**SOURCE, "field": "effort"}, "is": "linkage.crank.effort", "sigma": 1.0},
        ],
    }
)
WISH: dict[str, Any] = {
    "figure": "torque_peak_nm",
    "wanted": 220.0,
    "output": AdviceOutput(key=COMMAND, low=0.5, high=1.0, value=1.0),
    "step_share": 0.2,
    "cycles": 3,
    "interval_s": 2.0,
    "settling_cycles": 2,
    "trial_cycles": 2,
}


@contextmanager
def plant() -> Iterator[subprocess.Popen[bytes]]:
    """Run the twin in the place of a machine."""
    settings = [word for pair in HIDDEN for word in ("--set", pair)]
    place = ["--namespace", "plant", "--no-record", "--view", "none", "--pace", "realtime"]
    with subprocess.Popen([sys.executable, "-m", "mech_twin", "run", NAME, *place, *settings]) as process:
        try:
            yield process
        finally:
            process.terminate()


class AdvisedMachine(ShadowBench):
    """Shadow and advisor of the plant, and an operator who hears them."""

    def __init__(self, *, dry_run: bool) -> None:
        super().__init__(NAME, MAP, Company(advice=AdviceWish.model_validate({**WISH, "dry_run": dry_run})))
        self.advisor: AdvisorNode = self.of(AdvisorNode)
        self.commands: list[Float64] = []
        self.decisions: list[str] = []
        self.offers: list[DiagnosticStatus] = []
        subscribe, said = self.client.create_subscription, DiagnosticStatus
        subscribe(Float64, "/plant/motor/speed_command", self.commands.append, DATA)
        subscribe(said, full_name(NAME, DECISIONS), lambda heard: self.decisions.append(heard.message), DATA)
        subscribe(said, full_name(NAME, RECOMMENDATION), self.offers.append, LATCHED)

    def answer(self, service: str) -> SetBool.Response:
        return self.call(SetBool, f"/{NAME}/advisor/{service}", SetBool.Request(data=True))

    def figure(self) -> float:
        """Return the mean figure of the next cycles."""
        advisor = self.advisor
        advisor._figures.clear()
        self.until(lambda: len(advisor._figures) >= 2)
        return float(np.mean(advisor._figures))

    def __enter__(self) -> AdvisedMachine:
        self.until(lambda: self.advisor.state.phase == "offered")
        self.until(lambda: any("offered" in text for text in self.decisions))
        return self


@pytest.mark.slow
def test_accepted_advice_brings_the_figure_of_a_machine_with_hidden_parameters_as_promised() -> None:
    with plant(), AdvisedMachine(dry_run=False) as bench:
        before = bench.figure()
        advice = bench.advisor.state.advice
        assert advice is not None
        assert bench.commands == []
        assert bench.shadow.level == "shadow"
        assert {value.key: value.value for value in bench.offers[-1].values}["key"] == COMMAND
        assert bench.answer("accept").success
        bench.until(lambda: any("kept" in text for text in bench.decisions))
        assert [command.data for command in bench.commands] == [advice.proposed]
        came = abs(before - 220.0) - abs(bench.figure() - 220.0)
        assert came == pytest.approx(advice.gain, abs=max(advice.gain_high - advice.gain, 0.1 * advice.gain))
        bench.until(lambda: bench.shadow.level == "twin")


@pytest.mark.slow
def test_refused_and_dry_advice_changes_nothing_and_a_lost_advisor_leaves_the_machine_where_it_was() -> None:
    with plant(), AdvisedMachine(dry_run=True) as bench:
        before = bench.figure()
        assert bench.answer("reject").success
        bench.until(lambda: bench.advisor.state.phase == "offered")
        assert "dry run" in bench.answer("accept").message
        after = bench.figure()
        assert bench.client.count_publishers("/plant/motor/speed_command") == 0
        assert bench.commands == []
        speed = bench.shadow.observer.columns["linkage.crank.velocity"]
        told = bench.shadow.estimate
        bench.spinner.remove(bench.advisor)
        assert told is not None
        bench.until(lambda: bench.shadow.time_s > told.time_s + 2.0)
        assert bench.shadow.estimate is not None
        assert bench.shadow.estimate.row[speed] == pytest.approx(told.row[speed], rel=0.02)
        assert bench.commands == []
    assert after == pytest.approx(before, rel=0.01)


def test_an_advice_that_is_refused_opens_no_recording_and_removes_none(tmp_path: Path) -> None:
    wrong = {**WISH, "figure": "stroke_m", "output": WISH["output"].model_dump()}
    file, known = tmp_path / "advice.yaml", tmp_path / "known"
    file.write_text(yaml.safe_dump(wrong), encoding="utf-8")
    known.mkdir()
    (known / "metadata.yaml").write_text("of an earlier run", encoding="utf-8")
    for record in (known, tmp_path / "new"):
        ended = mech_twin("shadow", NAME, "--from", "plant", "--advise", file, "--record", record, "--force")
        assert ended.code == 2
        assert f"{file}: key 'figure', value 'stroke_m'" in ended.err
    assert (known / "metadata.yaml").exists()
    assert not (tmp_path / "new").exists()


def test_a_node_that_refuses_to_start_beside_a_shadow_leaves_no_recording(ros: None, tmp_path: Path) -> None:
    parameters = built(NAME).parameters
    shadow = ShadowNode(NAME, ShadowSetup("/plant", MAP), parameters)
    try:
        wish = AdviceWish.model_validate({**WISH, "figure": "stroke_m"})
        with pytest.raises(ConfigurationError, match="key 'figure'"):
            nodes_beside(NAME, shadow, parameters, Company(tmp_path / "bag", advice=wish))
        assert not (tmp_path / "bag").exists()
    finally:
        destroy_nodes([shadow])


@pytest.fixture
def advisor(ros: None) -> Iterator[AdvisorNode]:
    """Return the advisor of a machine whose clock was at 1 800 000 000 s when its times began."""
    origin = StampOrigin()
    origin.second = 1_800_000_000
    wish = AdviceWish.model_validate({**WISH, "dry_run": False})
    node = AdvisorNode(NAME, wish, "/plant", ("linkage.crank.position", "linkage.crank.effort"), origin)
    try:
        yield node
    finally:
        destroy_nodes([node])


ADVICE = Recommendation(COMMAND, 1.0, 0.9, 0.5, 1.0, "torque_peak_nm", 40.0, 30.0, 50.0, "evidence", 700.0)


def test_an_advice_tells_the_time_of_the_machines_clock(advisor: AdvisorNode, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[DiagnosticStatus] = []
    for outlet in (advisor._decisions, advisor._recommendation):
        monkeypatch.setattr(outlet, "send", told.append)
    advisor._take(offered(advisor.state, ADVICE, 100.0))
    times = {value.key: value.value for status in told for value in status.values}
    assert (float(times["time s"]), float(times["expires s"])) == (1_800_000_100.0, 1_800_000_700.0)


@pytest.mark.parametrize("end", ["silence", "no", "restart", "close"])
def test_a_machine_that_was_stopped_in_a_trial_is_not_started_by_its_end(
    end: str, advisor: AdvisorNode, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[float] = []
    assert advisor._send_value is not None
    monkeypatch.setattr(advisor, "_send_value", sent.append)
    advisor._take(offered(advisor.state, ADVICE, 1.0))
    assert advisor.accept()[0]
    assert sent == [0.9]
    advisor._received_s -= 10.0
    ends = {
        "silence": lambda: advisor.check_peers(advisor._received_s + 10.0),
        "no": advisor.reject,
        "restart": advisor.begin_anew,
        "close": advisor.close,
    }
    ends[end]()
    assert (advisor.state.phase, advisor.state.in_force) == ("idle", True)
    advisor._take(offered(advisor.state, ADVICE, 40.0))
    assert advisor.accept()[1] == "the machine stands, and a speed would start it"
    assert len(sent) == 1


def test_a_speed_that_another_commands_ends_a_trial_and_is_where_the_next_advice_begins(advisor: AdvisorNode) -> None:
    advisor._take(offered(advisor.state, ADVICE, 1.0))
    assert advisor.accept()[0]
    advisor.on_setting(COMMAND, 0.9)  # its own
    assert advisor.state.phase == "trial"
    advisor.on_setting(COMMAND, 0.7)
    assert (advisor.state.phase, advisor.state.in_force, advisor._value) == ("idle", False, 0.7)


def test_an_advisor_that_has_ended_begins_no_search(advisor: AdvisorNode) -> None:
    advisor.close()
    for number in range(10):
        begin_s, figure = 10.0 * number, np.array([100.0 + number])
        advisor._on_cycle(FeatureVector(number, begin_s, begin_s + 10.0, (advisor.wish.figure,), figure))
    assert advisor._thinking is None


@pytest.mark.parametrize("event", ["command", "restart"])
def test_an_advice_computed_before_another_changed_the_output_is_not_offered(event: str, advisor: AdvisorNode) -> None:
    found: Future[Recommendation | None] = Future()
    advisor._thinking = found
    if event == "command":
        advisor.on_setting(COMMAND, 0.7)
    else:
        advisor.begin_anew()
    found.set_result(ADVICE)
    advisor.check_peers(advisor._received_s)
    assert advisor.state.phase == "idle"


def test_a_live_parameter_that_another_changes_ends_an_offer_and_is_where_the_next_advice_begins(ros: None) -> None:
    key, columns = "friction.coulomb_nm", ("linkage.crank.position", "linkage.crank.effort")
    output = AdviceOutput(key=key, low=0.0, high=8.0, value=0.0)
    wish = AdviceWish.model_validate({**WISH, "output": output})
    advisor = AdvisorNode(NAME, wish, "/plant", columns, StampOrigin())
    others = [Node("linkage", namespace=space) for space in ("plant", "other")]
    try:
        advisor._take(offered(advisor.state, ADVICE._replace(key=key, value=0.0, proposed=1.0, low=0.0, high=8.0), 1.0))
        for other in others:
            other.declare_parameter(key, 0.0)
            other.declare_parameter("working_force_n", 0.0)
            other.set_parameters([Parameter("working_force_n", value=4.0)])
        others[1].set_parameters([Parameter(key, value=3.0)])
        with Spinner([advisor, *others]) as spinner:
            seen_s = time.monotonic() + 0.5
            spinner.until(lambda: time.monotonic() > seen_s)
            assert (advisor.state.phase, advisor._value) == ("offered", 0.0)
            others[0].set_parameters([Parameter(key, value=5.0)])
            end_s = time.monotonic() + 5.0
            spinner.until(lambda: advisor.state.phase == "idle" or time.monotonic() > end_s)
        assert (advisor.state.phase, advisor._value) == ("idle", 5.0)
    finally:
        destroy_nodes([advisor])
        for other in others:
            other.destroy_node()


def test_the_decision_by_which_an_advisor_ends_is_recorded(tmp_path: Path) -> None:
    wish = AdviceWish.model_validate({**WISH, "dry_run": False})
    with ShadowBench(NAME, MAP, Company(advice=wish, record=tmp_path / "bag")) as bench:
        advisor, recorder = bench.of(AdvisorNode), bench.of(ShadowRecorder)
        name = full_name(NAME, DECISIONS)
        machine = bench.client.create_publisher(JointState, "/plant/joint_states", 10)
        bench.until(lambda: advisor.count_subscribers(name) > 0 and machine.get_subscription_count() > 0)
        for place in range(5):  # the machine's time is known
            machine.publish(JointState(header=Header(stamp=Time(nanosec=10_000_000 * place))))
        bench.until(lambda: recorder.admission.clock.now_ns is not None)
        advisor._take(offered(advisor.state, ADVICE, 1.0))
        assert advisor.accept()[0]
        record_decisions(bench.spinner, bench.nodes)
        assert advisor.state.phase == "idle"
        assert recorder.received[name] == 3  # offered, accepted, reverted


def test_a_value_that_the_machine_refuses_ends_its_trial_in_the_machines_words(ros: None) -> None:
    key, columns = "friction.coulomb_nm", ("linkage.crank.position", "linkage.crank.effort")
    output = AdviceOutput(key=key, low=0.0, high=8.0, value=0.0)
    wish = AdviceWish.model_validate({**WISH, "output": output, "dry_run": False})
    advisor, machine, told = (
        AdvisorNode(NAME, wish, "/plant", columns, StampOrigin()),
        Node("linkage", namespace="plant"),
        [],
    )
    machine.create_subscription(DiagnosticStatus, f"/{NAME}/{DECISIONS.name}", told.append, DATA)
    try:
        machine.declare_parameter(key, 0.0)
        machine.add_on_set_parameters_callback(lambda _: SetParametersResult(successful=False, reason="too fast"))
        advice = ADVICE._replace(key=key, value=0.0, proposed=1.0, low=0.0, high=8.0)
        advisor._take(offered(advisor.state, advice, 1.0))
        with Spinner([advisor, machine]) as spinner:
            end_s = time.monotonic() + 20.0
            spinner.until(lambda: advisor.count_subscribers(DECISIONS.name) > 0 or time.monotonic() > end_s)
            assert advisor.accept()[0]
            said = "withdrawn: the machine refuses the value: too fast"
            spinner.until(lambda: said in [each.message for each in told] or time.monotonic() > end_s)
        assert told[-1].message == said
        assert (advisor.state.in_force, advisor._value) == (False, 0.0)
    finally:
        destroy_nodes([advisor])
        machine.destroy_node()


def test_a_live_parameter_that_is_changed_at_the_machine_is_that_of_the_model_too(ros: None) -> None:
    key, other = "friction.coulomb_nm", Node("linkage", namespace="plant")
    shadow = ShadowNode(NAME, ShadowSetup("/plant", MAP))
    nodes = [shadow, *nodes_beside(NAME, shadow, shadow.initial_parameters, Company(free=FreeKeys((key,), {})))]
    before, model = shadow.observer, shadow.model
    try:
        for name in (key, "run.step_count"):
            other.declare_parameter(name, 0.0)
        with Spinner([*nodes, other]) as spinner:
            other.set_parameters([Parameter("run.step_count", value=4.0), Parameter(key, value=5.0)])
            end_s = time.monotonic() + 30.0
            spinner.until(lambda: shadow.observer is not before or time.monotonic() > end_s)
        assert shadow.model == varied(model, {key: 5.0})
        assert shadow.observer is not before
        assert nodes[1].model == shadow.model
        follow_setting(nodes, key, -5.0)
        assert shadow.model == varied(model, {key: 5.0})
    finally:
        destroy_nodes(nodes)
        other.destroy_node()


def test_an_advice_after_a_restart_of_the_machine_needs_not_wait_for_a_change_before_it(advisor: AdvisorNode) -> None:
    advisor._now_s = 900.0
    advisor._take(offered(advisor.state, ADVICE._replace(expires_s=1500.0), 900.0))
    assert advisor.accept()[0]
    advisor.begin_anew()
    advisor._now_s = 5.0
    advisor._take(offered(advisor.state, ADVICE, 5.0))
    assert advisor.accept() == (True, "accepted: on trial for 2 cycles")
    advisor._now_s = 6.0
    assert advisor.reject()[0]
    assert advisor.accept()[1] == "nothing is offered"
