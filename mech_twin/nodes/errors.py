# SPDX-License-Identifier: Apache-2.0
"""What goes wrong with nodes as a whole; importing this needs no ROS."""

from __future__ import annotations


class NodeEndedError(RuntimeError):
    """A node's process ended by itself, with an error it has told itself."""


class NameInUseError(NodeEndedError):
    """Somebody publishes already on the topics this process was to publish on."""
