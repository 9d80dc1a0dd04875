# SPDX-License-Identifier: Apache-2.0
"""ROS 2 nodes: thin wrappers that give each role its topics, parameters and services."""

from mech_twin.process.dependencies import require_versions

require_versions()  # before any node module is imported, which would fail with a traceback
