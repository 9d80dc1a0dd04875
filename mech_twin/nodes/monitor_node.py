# SPDX-License-Identifier: Apache-2.0
"""The monitor node: judges each cycle of the machine a shadow follows, and names what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from mech_twin.configuration_tree import ConfigurationError
from mech_twin.messages.joint_state_cdr import Header, StepMessage, encoded
from mech_twin.messages.topics import DIAGNOSTICS, STANDARD_RESIDUALS
from mech_twin.nodes.base_node import TwinNode
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.shadow_inputs import StampOrigin
from mech_twin.parameters.load import catalogue_entry
from mech_twin.quantity import Parameters
from mech_twin.studies.live_monitor import LiveMonitor, changes_by_faults, fault_values, has_news
from mech_twin.studies.monitoring.fault_life import FaultLife
from mech_twin.studies.monitoring.monitor import Findings, MonitorSetup
from mech_twin.studies.observer.lock_on import SeenSample

FAULT, SHELVE_S = "fault", "shelve_s"
USUAL_SHELVE_S, LONGEST_SHELVE_S = 3600.0, 30.0 * 86400.0
LEVELS = {"active": DiagnosticStatus.WARN, "latched": DiagnosticStatus.WARN, "pending": DiagnosticStatus.OK}


class MonitorNode(TwinNode):
    """Judges cycles; see `TwinNode` for the other arguments.

    Its services act on the fault that its parameter ``fault`` names, on all of them where it is empty;
    ``shelve_s`` says for how long a fault is shelved.

    Parameters
    ----------
    setup : MonitorSetup
        Frozen reference, as `mech-twin monitor --save-baseline` writes it.
    columns : sequence of str
        Column of each channel of the samples.
    origin : StampOrigin
        What times are counted from.

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
        options: RunOptions | None = None,
    ) -> None:
        super().__init__("monitor", machine_name, parameters, options)
        ask = catalogue_entry(machine_name).capabilities.features
        if ask is None:
            raise ConfigurationError(f"{machine_name} declares no features of a cycle; expected a machine that does")
        self.live = LiveMonitor(setup, ask(self.initial_parameters), columns)
        self.on_active: Callable[[FaultLife], None] = lambda life: None
        self._origin, self._now_s = origin, 0.0
        self._states: dict[str, str] = {}
        self._standard = self.output(STANDARD_RESIDUALS, recorded=False)
        self._faults = self.output(DIAGNOSTICS, recorded=False)
        self.declare_parameter(FAULT, "")
        self.declare_parameter(SHELVE_S, USUAL_SHELVE_S)
        self.add_on_set_parameters_callback(_judged)
        self.create_service(Trigger, "~/acknowledge", self._acknowledge)
        self.create_service(Trigger, "~/shelve", self._shelve)

    def observe(self, sample: SeenSample) -> None:
        """Take a sample of the machine into account."""
        for found in self.live.take(sample):
            self._now_s, self.time_s = found.time_s, self._origin.clock_s(found.time_s)
            self.diagnostics.state = found.finding or found.verdict
            self._send_standard(found)
            self._tell_changes(found)

    @property
    def has_active_fault(self) -> bool:
        """Whether a fault is active, shelved or not."""
        return any(life.state == "active" for life in self.live.monitor.lives.values())

    @property
    def has_news(self) -> bool:
        """Whether a fault is active that nobody has acknowledged."""
        return has_news(self.live.monitor.lives.values())

    @property
    def known_changes(self) -> dict[str, Any]:
        """Keys of the configuration as the fault that is acknowledged has changed them."""
        ask = catalogue_entry(self.machine_name).capabilities.faults
        faults = () if ask is None else ask(self.initial_parameters)
        return changes_by_faults(self.initial_parameters, faults, self.live.monitor, self.live.newest)

    def diagnostic_values(self) -> dict[str, str]:
        """Return the newest cycle and its verdict."""
        found = self.live.newest
        return {} if found is None else {"cycle": str(found.number), "verdict": found.verdict}

    def report(self) -> None:
        """Publish the diagnostics of the node, and one status a fault."""
        super().report()
        if not self.quiet and self.live.newest is not None:
            self._send_faults(self.live.newest)

    def _send_standard(self, found: Findings) -> None:
        zeros = (0.0,) * len(found.names)
        header = Header(self._origin.stamp(found.time_s))
        self._standard.send(encoded(StepMessage(header, found.names, tuple(found.standard.tolist()), zeros, zeros)))

    def _tell_changes(self, found: Findings) -> None:
        """Publish at once what has changed, and call for the black box where a fault becomes active."""
        states: dict[str, str] = {life.name: life.state for life in found.faults}
        if states != self._states:
            self._send_faults(found)
        for life in found.faults:
            if life.state == "active" and self._states.get(life.name) != "active":
                self.get_logger().warning(f"{life.name} is active" + (" (shelved)" if self._is_shelved(life) else ""))
                self.on_active(life)
        self._states = states

    def _is_shelved(self, life: FaultLife) -> bool:
        return not life.is_announced(self._now_s)

    def _send_faults(self, found: Findings) -> None:
        message = DiagnosticArray()
        message.header.stamp.sec, message.header.stamp.nanosec = self._origin.stamp(found.time_s)
        for life in self.live.monitor.lives.values():
            status = DiagnosticStatus(name=f"{self.get_fully_qualified_name()}: {life.name}", message=life.state)
            status.hardware_id = self.machine_name
            seen = life.is_announced(self._now_s)
            status.level = LEVELS.get(life.state, DiagnosticStatus.OK) if seen else DiagnosticStatus.OK
            values = fault_values(self.live.monitor.setup, life, found)
            status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
            message.status.append(status)
        if message.status:
            self._faults.send(message)

    # -- services ---------------------------------------------------------------------------------------------------

    def _named(self) -> list[str]:
        """Return the faults that a service acts on."""
        told: Parameter = self.get_parameter(FAULT)
        lives = self.live.monitor.lives
        return [name for name in lives if told.value in ("", name)]

    def _acknowledge(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        for name in self._named():
            self.live.monitor.acknowledge(name, self._now_s)
        return self._answered(response, "acknowledged")

    def _shelve(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        until_s = self._now_s + float(self.get_parameter(SHELVE_S).value)
        for name in self._named():
            self.live.monitor.shelve(name, until_s)
        return self._answered(response, "shelved")

    def _answered(self, response: Trigger.Response, done: str) -> Trigger.Response:
        names = self._named()
        response.success = bool(names)
        told = self.get_parameter(FAULT).value
        response.message = (
            f"{done}: {', '.join(names)}" if names else f"no fault{f' {told!r}' if told else ''} to act on"
        )
        return response


def _judged(asked: list[Parameter]) -> SetParametersResult:
    """Return whether the parameters may be so; that a fault does not exist is said by the service that acts on it."""
    for parameter in asked:
        if parameter.name == SHELVE_S and not 0.0 < float(parameter.value) <= LONGEST_SHELVE_S:
            given = f"{SHELVE_S} = {parameter.value:g} s"
            return SetParametersResult(
                successful=False, reason=f"{given} must be above 0 and at most {LONGEST_SHELVE_S:g} s"
            )
    return SetParametersResult(successful=True)
