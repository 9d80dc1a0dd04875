# SPDX-License-Identifier: Apache-2.0
"""Alerts leave the machine: a real broker keeps them, a real scrape reads them, a yes makes them quiet."""

from __future__ import annotations

import json
import re
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

import numpy as np
import pytest

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.nodes.shadow.monitor_node import MqttOutlet, PrometheusOutlet, host_and_port
from mech_twin.studies.live_monitor import fault_values
from mech_twin.studies.monitoring.baseline import Baseline
from mech_twin.studies.monitoring.charts import ChartLimits, Thresholds
from mech_twin.studies.monitoring.diagnosis import Candidate
from mech_twin.studies.monitoring.findings import Alert, FaultLife, Findings, acknowledged, alerts_of, shelved
from mech_twin.studies.monitoring.monitor import MonitorSetup

LIMIT_S = 30.0
SOFT = Candidate("spring_soft", -0.2, -0.23, -0.17, "1", 0.01)
FOUND = Findings(9, 12.0, ("a",), np.zeros(1), None, verdict="named", candidates=(SOFT,))
ACTIVE = FaultLife("spring_soft", "active", 10.0, candidates=(SOFT,))
QUIET = Thresholds(1.0, 1.0, 1.0)
BASELINE = Baseline(("a",), np.zeros(1), np.zeros((0, 1)), np.eye(1), 100, 0.1)


def alerts(life: FaultLife) -> tuple[Alert, ...]:
    return alerts_of("mb10_breaker", [life], 12.0, origin_s=1000.0)


def until(predicate: Callable[[], bool]) -> None:
    end = time.monotonic() + LIMIT_S
    while not predicate() and time.monotonic() < end:
        time.sleep(0.02)
    assert predicate(), "did not happen within the limit"


def test_an_acknowledged_or_shelved_fault_is_no_alarm() -> None:
    (alert,) = alerts(ACTIVE)
    assert alert == Alert(
        "mb10_breaker", "spring_soft", "active", 1010.0, -0.2, -0.23, -0.17, "1", "spring_soft", False, True
    )
    assert not alerts(acknowledged(ACTIVE, 11.0))[0].alarm
    assert not alerts(shelved(ACTIVE, 100.0))[0].alarm
    assert not alerts(FaultLife("spring_soft", "pending", 10.0))[0].alarm


def test_the_values_of_a_fault_are_its_own_with_the_times_of_the_machines_clock() -> None:
    setup = MonitorSetup("mb10_breaker", BASELINE, ChartLimits(Thresholds(5.0, 9.0, 9.0), QUIET, 100.0, False))
    told = fault_values(setup, shelved(ACTIVE, 100.0), FOUND._replace(onset_s=8.0), origin_s=1.8e9)
    times = [told[name] for name in ("began s", "since s", "shelved until s")]
    assert times == ["1800000008.000", "1800000010.000", "1800000100.000"]
    assert told["candidates"] == "spring_soft -0.2 (-0.23 to -0.17)"
    other = fault_values(setup, FaultLife("sensor_stuck:a", "latched", 5.0), FOUND)
    assert [other[name] for name in ("began s", "delay cycles", "candidates")] == ["", "", ""]


@pytest.mark.parametrize("text", ["broker:abc", "broker:70000", "broker:-1"])
def test_an_address_that_is_none_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(ConfigurationError, match=r"--mqtt broker:.*expected HOST:PORT"):
        host_and_port(text, "--mqtt", 1883)
    assert host_and_port(":1884", "--mqtt", 1883) == ("127.0.0.1", 1884)
    assert host_and_port("broker", "--mqtt", 1883) == ("broker", 1883)


def test_a_scrape_tells_state_size_interval_and_since_when_and_is_quiet_after_a_yes() -> None:
    pytest.importorskip("prometheus_client")
    from prometheus_client.parser import text_string_to_metric_families

    outlet = PrometheusOutlet("127.0.0.1:0")

    def scraped() -> dict[str, float]:
        with urlopen(f"http://127.0.0.1:{outlet.port}/metrics", timeout=LIMIT_S) as answer:
            families = text_string_to_metric_families(answer.read().decode())
            return {f"{s.name}{s.labels.get('state', '')}": s.value for family in families for s in family.samples}

    try:
        assert scraped() == {}
        outlet.send(alerts(ACTIVE))
        told = scraped()
        assert told["mech_twin_fault_alarm"] == 1.0
        assert told["mech_twin_fault_stateactive"] == 1.0
        sizes = [told[f"mech_twin_fault_{name}"] for name in ("size", "size_low_95", "size_high_95", "since_seconds")]
        assert sizes == [-0.2, -0.23, -0.17, 1010.0]
        outlet.send(alerts(acknowledged(ACTIVE, 11.0)))
        assert (scraped()["mech_twin_fault_alarm"], scraped()["mech_twin_fault_acknowledged"]) == (0.0, 1.0)
        outlet.send(alerts(FaultLife("spring_soft", "cleared", 20.0)))
        assert scraped() == {}
        with pytest.raises(ConfigurationError, match="cannot serve there"):
            PrometheusOutlet(f"127.0.0.1:{outlet.port}")
    finally:
        outlet.close()


def lost(given: Any, kept: Any, place: str = "") -> list[str]:
    """Return what of a document is not in another, by its place."""
    if isinstance(given, dict) and isinstance(kept, dict):
        parts = [(key, value, kept.get(key, "nothing")) for key, value in given.items()]
    elif isinstance(given, list) and isinstance(kept, list) and len(given) == len(kept):
        parts = list(zip(map(str, range(len(given))), given, kept, strict=True))
    else:
        return [] if given == kept else [f"{place}: {given!r}, kept as {kept!r}"]
    return [each for key, value, other in parts for each in lost(value, other, f"{place}/{key}")]


def test_grafana_loads_the_dashboard_whole_and_what_it_asks_for_is_scraped() -> None:
    pytest.importorskip("prometheus_client")
    from grafana_foundation_sdk.cog.encoder import JSONEncoder
    from grafana_foundation_sdk.cog.plugins import register_default_plugins
    from grafana_foundation_sdk.models.dashboard import Dashboard
    from prometheus_client.parser import text_string_to_metric_families

    text = (Path(__file__).parents[2] / "config" / "grafana_faults.json").read_text(encoding="utf-8")
    given = json.loads(text)
    (asked_at_import,) = given.pop("__inputs")  # of the importer, not of the dashboard
    assert (asked_at_import["type"], asked_at_import["pluginId"]) == ("datasource", "prometheus")
    register_default_plugins()
    board = Dashboard.from_json(given)
    assert lost(given, json.loads(JSONEncoder().encode(board))) == []
    outlet = PrometheusOutlet("127.0.0.1:0")
    try:
        outlet.send(alerts(ACTIVE))
        with urlopen(f"http://127.0.0.1:{outlet.port}/metrics", timeout=LIMIT_S) as answer:
            samples = [s for family in text_string_to_metric_families(answer.read().decode()) for s in family.samples]
    finally:
        outlet.close()
    targets = [target for panel in board.panels for target in panel.targets]
    asked = {metric for target in targets for metric in re.findall(r"mech_twin_\w+", target.expr)}
    assert len(asked) >= 6
    assert asked <= {sample.name for sample in samples}
    shown = {label for target in targets for label in re.findall(r"{{(\w+)}}", target.legend_format)}
    assert shown <= {label for sample in samples for label in sample.labels}
    assert {target.datasource.uid for target in targets} == {f"${{{asked_at_import['name']}}}"}


LOG = "mosquitto.log"


@contextmanager
def mosquitto(folder: Path, port: int) -> Iterator[None]:
    """Run a broker that keeps nothing on the disk."""
    program = shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin:/usr/bin")
    if program is None:
        pytest.skip("no MQTT broker here: apt-get install mosquitto; CI has one")
    config = folder / "mosquitto.conf"
    config.write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\npersistence false\n", encoding="utf-8")
    with (folder / LOG).open("w") as log, subprocess.Popen([program, "-v", "-c", str(config)], stderr=log) as process:
        yield
        process.terminate()


@pytest.fixture
def port() -> int:
    """Return a free port of 127.0.0.1."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@pytest.fixture
def broker(tmp_path: Path, port: int) -> Iterator[int]:
    """Run a mosquitto on a free port of 127.0.0.1."""
    with mosquitto(tmp_path, port):
        yield port


@contextmanager
def listening(port: int) -> Iterator[dict[str, bytes]]:
    """Give what a client hears, the newest of each topic."""
    mqtt = pytest.importorskip("paho.mqtt.client")
    heard: dict[str, bytes] = {}
    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
    client.on_connect = lambda *_: client.subscribe("mech_twin/#", qos=1)
    client.on_message = lambda _, __, message: heard.__setitem__(message.topic, message.payload)
    client.connect_async("127.0.0.1", port)
    client.loop_start()
    yield heard
    client.disconnect()
    client.loop_stop()


TOPIC = "mech_twin/mb10_breaker/faults/spring_soft"


def test_a_broker_keeps_the_newest_of_each_fault_and_loses_it_when_the_fault_is_cleared(broker: int) -> None:
    outlet = MqttOutlet(f"127.0.0.1:{broker}", "mb10_breaker")
    outlet.send(alerts(ACTIVE))
    until(lambda: outlet.state == "connected")
    with listening(broker) as heard:  # subscribes after the alert was sent: a retained one is told all the same
        until(lambda: TOPIC in heard)
        told = json.loads(heard[TOPIC])
        assert (told["state"], told["size"], told["since_s"], told["alarm"]) == ("active", -0.2, 1010.0, True)
        outlet.send(alerts(acknowledged(ACTIVE, 11.0)))
        until(lambda: not json.loads(heard[TOPIC])["alarm"])
        assert json.loads(heard[TOPIC])["acknowledged"]
        outlet.send(alerts(FaultLife("spring_soft", "cleared", 20.0)))
        until(lambda: heard[TOPIC] == b"")
        outlet.close()


@pytest.mark.slow
def test_a_fault_that_an_earlier_shadow_left_at_the_broker_goes_with_the_first_word_of_the_next(broker: int) -> None:
    first, other = (MqttOutlet(f"127.0.0.1:{broker}", name) for name in ("mb10_breaker", "another"))
    first.send(alerts(ACTIVE))
    other.send(tuple(alert._replace(machine="another") for alert in alerts(ACTIVE)))
    with listening(broker) as heard:
        until(lambda: len(heard) == 2)
        first.close()
        second = MqttOutlet(f"127.0.0.1:{broker}", "mb10_breaker")
        until(lambda: (second.send(()), heard[TOPIC] == b"")[1])
        assert heard[TOPIC.replace("mb10_breaker", "another")] != b""
        second.close()
        other.close()


@pytest.mark.slow
def test_a_broker_that_comes_back_empty_is_told_again(tmp_path: Path, port: int) -> None:
    with mosquitto(tmp_path, port):
        outlet = MqttOutlet(f"127.0.0.1:{port}", "mb10_breaker")
        outlet.send(alerts(ACTIVE))
        until(lambda: outlet.state == "connected")
    until(lambda: outlet.state == "not connected")
    with mosquitto(tmp_path, port), listening(port) as heard:
        until(lambda: TOPIC in heard)
        outlet.close()


@pytest.mark.slow
def test_of_what_happens_while_a_broker_is_away_it_hears_the_newest_alone(tmp_path: Path, port: int) -> None:
    outlet = MqttOutlet(f"127.0.0.1:{port}", "mb10_breaker")
    for life in (FaultLife("spring_soft", "pending", 9.0), ACTIVE, acknowledged(ACTIVE, 11.0)):
        outlet.send(alerts(life))
    with mosquitto(tmp_path, port), listening(port) as heard:
        until(lambda: TOPIC in heard)
        assert json.loads(heard[TOPIC])["acknowledged"]
        outlet.close()
    assert (tmp_path / LOG).read_text(encoding="utf-8").count("Received PUBLISH") == 1


def test_a_broker_that_is_not_there_stops_nothing() -> None:
    pytest.importorskip("paho.mqtt.client")
    begun_s = time.monotonic()
    outlet = MqttOutlet("127.0.0.1:1", "mb10_breaker")
    outlet.send(alerts(ACTIVE))
    assert outlet.state == "not connected"
    outlet.close()
    assert time.monotonic() - begun_s < LIMIT_S
