# SPDX-License-Identifier: Apache-2.0
"""The one way from an advisor to a machine: its speed command, or a live parameter of its linkage."""

from __future__ import annotations

from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Float64

from mech_twin.messages.topics import SPEED_COMMAND
from mech_twin.studies.advice import Setting
from mech_twin.studies.advice_search import COMMAND


class AdviceOutlet:
    """Sends settings of one output; made only where something may go out.

    Parameters
    ----------
    node : Node
        Who sends.
    namespace : str
        The machine's.
    key : str
        The output.
    """

    def __init__(self, node: Node, namespace: str, key: str) -> None:
        self._key = key
        if key == COMMAND:
            name = f"{namespace}/{SPEED_COMMAND.name}"
            self._publisher = node.create_publisher(Float64, name, SPEED_COMMAND.qos)
        else:
            self._client = node.create_client(SetParameters, f"{namespace}/linkage/set_parameters")

    def send(self, setting: Setting) -> None:
        """Send a setting.

        Raises
        ------
        ValueError
            It is of another output than the one allowed.
        """
        if setting.key != self._key:
            raise ValueError(f"setting of {setting.key!r}: expected {self._key!r}")
        if self._key == COMMAND:
            self._publisher.publish(Float64(data=setting.value))
            return
        parameter = Parameter(setting.key, value=setting.value).to_parameter_msg()
        self._client.call_async(SetParameters.Request(parameters=[parameter]))
