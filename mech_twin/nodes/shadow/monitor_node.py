# SPDX-License-Identifier: Apache-2.0
"""The monitor node: evaluates each cycle of the machine that a shadow follows, and names its faults.

Besides ``/diagnostics`` alerts go to an MQTT broker, and to a page that Prometheus scrapes.  A failing outlet never
stops the monitoring: MQTT retries in a thread of its own, with the newest alert of each fault waiting.
"""

import json
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_srvs.srv import Trigger

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.declarations.quantity import Parameters
from mech_twin.messages.cdr import Header, StepMessage, encoded
from mech_twin.messages.topics import DIAGNOSTICS, STANDARD_RESIDUALS
from mech_twin.nodes.exchange.base_node import TwinNode
from mech_twin.nodes.exchange.counting import status_message
from mech_twin.nodes.exchange.parameter_bridge import declare_range, offer
from mech_twin.nodes.shadow.inputs import StampOrigin
from mech_twin.parameters.load import catalogue_entry
from mech_twin.process.dependencies import extra_needed
from mech_twin.studies.live_monitor import LiveMonitor, changes_by_faults, fault_values, has_news
from mech_twin.studies.monitoring.cycle_features import LONGEST_CYCLE
from mech_twin.studies.monitoring.findings import Alert, FaultLife, Findings, alerts_of
from mech_twin.studies.monitoring.monitor import MonitorSetup
from mech_twin.studies.observer.estimate import SeenSample

LOCAL, MQTT_PORT = "127.0.0.1", 1883
ROOT = "mech_twin"
LONGEST_RETRY_S = 60


def mqtt_topic(alert: Alert) -> str:
    """Return the MQTT topic of a fault; no level contains special characters of MQTT."""
    level = re.sub(r"[+#/\s]+", "_", alert.name)
    return f"{ROOT}/{alert.machine}/faults/{level}"


def host_and_port(text: str, option: str, usual: int) -> tuple[str, int]:
    """Return ``HOST:PORT``, ``HOST`` or ``:PORT``.

    Raises
    ------
    ConfigurationError
        If the port is invalid.
    """
    host, _, port = text.rpartition(":") if ":" in text else (text, "", str(usual))
    if not port.isdigit() or not 0 <= int(port) <= 65535:
        raise ConfigurationError(f"{option} {text}: expected HOST:PORT, the port 0 to 65535")
    return host or LOCAL, int(port)


class MqttOutlet:
    """Publishes each fault as a retained JSON message, and removes it when the fault is cleared.

    What an earlier shadow has left there of this machine is removed as well, once there is something to say.  To a
    broker that comes back everything is sent again.

    Parameters
    ----------
    address : str
        ``HOST:PORT`` of the broker.
    machine : str
        Name of the machine in the alerts.

    Raises
    ------
    ConfigurationError
        The extra is not installed, or the address is none.
    """

    def __init__(self, address: str, machine: str) -> None:
        try:
            from paho.mqtt.client import Client
            from paho.mqtt.enums import CallbackAPIVersion
        except ImportError as error:
            raise ConfigurationError(f"--mqtt {extra_needed('alerts')}") from error
        self._host, self._port = host_and_port(address, "--mqtt", MQTT_PORT)
        self.name, self.state = "mqtt", "not connected"
        self._every, self._sent = f"{ROOT}/{machine}/faults/+", dict[str, bytes]()
        self._client: Any = Client(CallbackAPIVersion.VERSION2)
        self._client.on_connect, self._client.on_message = self._on_connect, self._on_retained
        self._client.on_disconnect = self._on_disconnect
        self._client.reconnect_delay_set(1, LONGEST_RETRY_S)
        self._client.connect_async(self._host, self._port)
        self._client.loop_start()

    def send(self, alerts: Sequence[Alert]) -> None:
        """Publish the changed alerts."""
        payloads = {mqtt_topic(each): json.dumps(each._asdict()).encode() for each in alerts if each.state != "cleared"}
        for topic in (*payloads, *(known for known in tuple(self._sent) if known not in payloads)):
            payload = payloads.get(topic, b"")
            if self._sent.get(topic, b"") != payload:
                self._sent[topic] = payload
                if self._client.is_connected():  # else on_connect sends the newest alone
                    self._client.publish(topic, payload, qos=1, retain=True)

    def _on_connect(self, client: Any, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        self.state = f"refused: {reason}" if reason.is_failure else "connected"
        if not reason.is_failure:
            client.subscribe(self._every, qos=1)
            for topic in tuple(self._sent):
                client.publish(topic, self._sent[topic], qos=1, retain=True)

    def _on_disconnect(self, client: Any, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        self.state = self.state if self.state.startswith("refused") else "not connected"

    def _on_retained(self, client: Any, data: Any, message: Any) -> None:
        if message.retain:
            self._sent.setdefault(message.topic, message.payload)

    def close(self) -> None:
        """Disconnect from the broker; the retained messages stay as the machine's newest state."""
        self._client.disconnect()
        self._client.loop_stop()


class PrometheusOutlet:
    """Serves the newest alerts as metrics, on 127.0.0.1 unless another host is named.

    Parameters
    ----------
    address : str
        ``HOST:PORT`` to serve on; port 0 chooses a free one.

    Raises
    ------
    ConfigurationError
        The extra is not installed, or the address is not valid or in use.
    """

    def __init__(self, address: str) -> None:
        try:
            from prometheus_client import CollectorRegistry, start_http_server
        except ImportError as error:
            raise ConfigurationError(f"--prometheus {extra_needed('alerts')}") from error
        self.name, self.state = "prometheus", f"served at {address}"
        host, port = host_and_port(address, "--prometheus", 0)
        self._alerts: tuple[Alert, ...] = ()
        registry = CollectorRegistry()
        registry.register(self)
        try:
            self._server, self._thread = start_http_server(port, host, registry)
        except OSError as error:
            raise ConfigurationError(f"--prometheus {address}: cannot serve there: {error.strerror}") from error

    @property
    def port(self) -> int:
        """Port of the server."""
        return int(self._server.server_port)

    def send(self, alerts: Sequence[Alert]) -> None:
        """Store the alerts for the next scrape."""
        self._alerts = tuple(alert for alert in alerts if alert.state != "cleared")

    def collect(self) -> Iterator[Any]:
        """Yield the metrics, as required by the client library."""
        from prometheus_client.core import GaugeMetricFamily

        alerts, labels = self._alerts, ("machine", "fault")
        tables: tuple[tuple[str, str, Iterable[tuple[Alert, float | None]]], ...] = (
            ("alarm", "1 while somebody is to come", ((a, float(a.alarm)) for a in alerts)),
            ("acknowledged", "1 where somebody has said yes", ((a, float(a.acknowledged)) for a in alerts)),
            ("size", "size of the fault, in its unit", ((a, a.size) for a in alerts)),
            ("size_low_95", "lower end of its 95 % interval", ((a, a.low_95) for a in alerts)),
            ("size_high_95", "upper end of its 95 % interval", ((a, a.high_95) for a in alerts)),
            ("since_seconds", "the machine's clock since when", ((a, a.since_s) for a in alerts)),
        )
        for name, meaning, rows in tables:
            family = GaugeMetricFamily(f"{ROOT}_fault_{name}", meaning, labels=labels)
            for alert, value in rows:
                if value is not None:
                    family.add_metric((alert.machine, alert.name), value)
            yield family
        states = GaugeMetricFamily(f"{ROOT}_fault_state", "1 for the state of the fault", labels=(*labels, "state"))
        for alert in alerts:
            states.add_metric((alert.machine, alert.name, alert.state), 1.0)
        yield states

    def close(self) -> None:
        """Stop the server."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


AlertOutlet = MqttOutlet | PrometheusOutlet
FAULT, SHELVE_S = "fault", "shelve_s"
USUAL_SHELVE_S, SHORTEST_SHELVE_S, LONGEST_SHELVE_S = 3600.0, 1e-3, 30.0 * 86400.0
SEEN = ("active", "latched")  # seen in enough cycles to be acknowledged
LEVELS = {"active": DiagnosticStatus.WARN, "latched": DiagnosticStatus.WARN, "pending": DiagnosticStatus.OK}


class MonitorNode(TwinNode):
    """Monitors cycles; see `TwinNode` for the other arguments.

    Its services act on the faults that the parameter ``fault`` names, alone or in a group, or on all if it is empty;
    ``shelve_s`` is the time for which a fault is shelved (s).

    Parameters
    ----------
    setup : MonitorSetup
        Frozen reference, as `mech-twin monitor --save-baseline` writes it.
    columns : sequence of str
        Column of each channel of the samples.
    origin : StampOrigin
        Origin of the times.

    Raises
    ------
    ConfigurationError
        The machine declares no features of a cycle.
    """

    def __init__(
        self,
        machine_name: str,
        setup: MonitorSetup,
        columns: Sequence[str],
        origin: StampOrigin,
        parameters: Parameters | None = None,
    ) -> None:
        super().__init__("monitor", machine_name, parameters)
        ask = catalogue_entry(machine_name).capabilities.features
        if ask is None:
            raise ConfigurationError(f"{machine_name} declares no features of a cycle; expected a machine that does")
        self.live = LiveMonitor(setup, ask(self.initial_parameters), columns)
        self.on_active: Callable[[FaultLife], None] = lambda life: None
        self.outlets: Sequence[AlertOutlet] = ()
        self._origin, self._now_s = origin, 0.0
        self._states: dict[str, str] = {}
        self._standard = self.output(STANDARD_RESIDUALS, recorded=False)
        self._faults = self.output(DIAGNOSTICS, recorded=False)
        self.declare_parameter(FAULT, "")
        text = "time for which a fault is shelved [s]"
        declare_range(self, SHELVE_S, USUAL_SHELVE_S, text, SHORTEST_SHELVE_S, LONGEST_SHELVE_S)
        offer(self, Trigger, "~/acknowledge", lambda _: self.acknowledge())
        offer(self, Trigger, "~/shelve", lambda _: self.shelve())

    def observe(self, sample: SeenSample) -> None:
        """Update with a sample of the machine."""
        for found in self.live.take(sample):
            self._now_s, self.time_s = found.time_s, self._origin.clock_s(found.time_s)
            missing = f"missing: {', '.join(found.missing)}" if found.missing else ""
            self.diagnostics.state = found.finding or missing or found.verdict
            self._send_standard(found)
            for event in found.events:
                self.get_logger().info(event._replace(time_s=self._origin.clock_s(event.time_s)).text)
            self._tell_changes(found)
        newest = self.live.newest
        if (
            newest is not None
            and sample.time_s - newest.time_s > LONGEST_CYCLE * self.live.monitor.setup.baseline.period_s
        ):
            self.diagnostics.state = f"no cycle since {self._origin.clock_s(newest.time_s):.3f} s"

    @property
    def has_news(self) -> bool:
        """Whether there is an active fault that is not acknowledged."""
        return has_news(self.live.monitor.lives.values())

    @property
    def known_changes(self) -> dict[str, Any]:
        """Keys of the configuration as changed by the acknowledged fault."""
        ask = catalogue_entry(self.machine_name).capabilities.faults
        faults = () if ask is None else ask(self.initial_parameters)
        return changes_by_faults(self.initial_parameters, faults, self.live.monitor, self.live.newest)

    def diagnostic_values(self) -> dict[str, str]:
        """Return the newest cycle and its evaluation."""
        found, reached = self.live.newest, {outlet.name: outlet.state for outlet in self.outlets}
        return reached if found is None else {"cycle": str(found.number), "verdict": found.verdict, **reached}

    def report(self) -> None:
        """Publish the diagnostics of the node, and one status per fault."""
        super().report()
        if not self.quiet and self.live.newest is not None:
            self._send_faults(self.live.newest)

    def _send_standard(self, found: Findings) -> None:
        zeros = (0.0,) * len(found.names)
        header = Header(self._origin.stamp(found.time_s))
        self._standard.send(encoded(StepMessage(header, found.names, tuple(found.standard.tolist()), zeros, zeros)))

    def _tell_changes(self, found: Findings) -> None:
        """Publish changes at once, and trigger the black box when a fault becomes active."""
        states: dict[str, str] = {life.name: life.state for life in found.faults}
        if states != self._states:
            self._send_faults(found)
        for life in found.faults:
            if life.state == "active" and self._states.get(life.name) != "active":
                shelved = "" if life.is_announced(self._now_s) else " (shelved)"
                self.get_logger().warning(f"{life.name} is active{shelved}")
                self.on_active(life)
        self._states = states

    def _send_faults(self, found: Findings) -> None:
        message, setup, origin_s = DiagnosticArray(), self.live.monitor.setup, self._origin.clock_s(0.0)
        message.header.stamp.sec, message.header.stamp.nanosec = self._origin.stamp(found.time_s)
        for life in self.live.monitor.lives.values():
            name = f"{self.get_fully_qualified_name()}: {life.name}"
            values = fault_values(setup, life, found, origin_s)
            seen = life.is_announced(self._now_s)
            level = LEVELS.get(life.state, DiagnosticStatus.OK) if seen else DiagnosticStatus.OK
            own = self.diagnostics.hardware
            message.status.append(status_message(name, life.state, values, level=level, hardware_id=own))
        if message.status:
            self._faults.send(message)
        own = self.get_namespace().removeprefix("/")
        alerts = alerts_of(own, self.live.monitor.lives.values(), self._now_s, origin_s)
        for outlet in self.outlets:
            outlet.send(alerts)

    def destroy_node(self) -> None:
        """Close the outlets and destroy the node."""
        for outlet in self.outlets:
            outlet.close()
        super().destroy_node()

    # -- services ---------------------------------------------------------------------------------------------------

    def acknowledge(self) -> tuple[bool, str]:
        """Acknowledge the faults that the parameter names."""
        acknowledge = self.live.monitor.acknowledge
        return self._done("acknowledged", SEEN, lambda name: acknowledge(name, self._now_s))

    def shelve(self) -> tuple[bool, str]:
        """Shelve the faults that the parameter names."""
        until_s = self._now_s + float(self.get_parameter(SHELVE_S).value)
        return self._done("shelved", LEVELS, lambda name: self.live.monitor.shelve(name, until_s))

    def _done(self, done: str, states: Collection[str], act: Callable[[str], None]) -> tuple[bool, str]:
        """Act on the faults in these states that the parameter names, alone or in a group; answer on which."""
        fault, lives = self.get_parameter(FAULT).value, self.live.monitor.lives
        living = [name for name, life in lives.items() if life.state in LEVELS]
        asked = [name for name in living if fault in ("", name, *name.split(" or "))]
        names = [name for name in asked if lives[name].state in states]
        for name in names:
            act(name)
        if names and self.live.newest is not None:
            self._send_faults(self.live.newest)
        there = "; ".join(f"{name} is {lives[name].state}" for name in living) or "there is none"
        none = f"no fault{f' {fault!r}' if fault else ''} that can be {done}: {there}"
        return bool(names), f"{done}: {', '.join(names)}" if names else none
