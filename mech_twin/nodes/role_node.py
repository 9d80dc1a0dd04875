# SPDX-License-Identifier: Apache-2.0
"""What the four role nodes share: the machine, and the configuration the linkage publishes."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from mech_twin.engine.run import warm_up
from mech_twin.messages.step_marks import revision_row
from mech_twin.messages.step_message import SOURCE, Row
from mech_twin.messages.stream_window import steps_per_window
from mech_twin.nodes.base_node import TwinNode
from mech_twin.nodes.options import RunOptions
from mech_twin.nodes.parameter_bridge import keys
from mech_twin.nodes.source_lock import ANONYMOUS, new_source
from mech_twin.parameters.load import catalogue_entry, is_of_ros
from mech_twin.quantity import Parameters
from mech_twin.roles import Machine
from mech_twin.samples import Sample

RETRY_S = 0.02


def _unobserved(sample: Sample) -> None:
    """Take a sample nobody observes."""


class RoleNode(TwinNode):
    """A node that is a shell around one role of a machine; see `TwinNode` for the arguments."""

    def __init__(
        self, role: str, machine_name: str, parameters: Parameters | None = None, options: RunOptions | None = None
    ) -> None:
        super().__init__(role, machine_name, parameters, options)
        self.machine: Machine = catalogue_entry(machine_name).build(self.initial_parameters)
        warm_up(self.machine)
        self.diagnostics.limits(self.residual_limits(), self.machine.coupling_step_s)
        self.source = new_source()
        self.signature = Row(SOURCE, self.source)
        self.stream_window = steps_per_window(self.options.stream_rate_hz, self.machine.coupling_step_s)
        self.revision = 0
        self.described_by = ANONYMOUS
        self.description = ""
        self.on_sample: Callable[[Sample], None] = _unobserved
        self._adopting = False
        self._marked: tuple[int, float] | None = None
        self._marks: tuple[Row, ...] = ()
        self.add_on_set_parameters_callback(self.judge_parameters)

    def residual_limits(self) -> Mapping[str, float]:
        """Return the limit of each residual this node publishes."""
        return {}

    @property
    def marks(self) -> tuple[Row, ...]:
        """Rows this node adds to its step messages: the configuration they were computed with, and who it is."""
        if self._marked != (self.revision, self.described_by):
            self._marked = self.revision, self.described_by
            self._marks = revision_row(*self._marked), self.signature
        return self._marks

    def use(self, parameters: Parameters) -> None:
        """Rebuild the role from new parameters, and show them as this node's own."""
        if parameters == self.machine.parameters:
            return
        before = {key.name: key.value for key in keys(self.machine.parameters)}
        self.machine = catalogue_entry(self.machine.name).build(parameters)
        self.diagnostics.limits(self.residual_limits(), self.machine.coupling_step_s)
        changed = [
            Parameter(key.name, value=key.value)
            for key in keys(parameters)
            if key.live and key.value != before.get(key.name)
        ]
        self._adopting = True
        try:
            self.set_parameters(changed)
        finally:
            self._adopting = False

    def judge_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        """Refuse a change made here: the linkage passes parameters on, so that all roles change at one step."""
        own = [change.name for change in changes if not is_of_ros(change.name)]
        if self._adopting or not own:
            return SetParametersResult(successful=True)
        names = ", ".join(own)
        return SetParametersResult(successful=False, reason=f"{names}: set it on node linkage, which passes it on")
