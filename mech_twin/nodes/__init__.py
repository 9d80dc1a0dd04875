# SPDX-License-Identifier: Apache-2.0
"""ROS 2 nodes: thin shells around the roles."""

from mech_twin.process.dependencies import require_versions

require_versions()  # before anything of a node, which would fail with a trace, is loaded
