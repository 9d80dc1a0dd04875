# SPDX-License-Identifier: Apache-2.0
"""The mech-twin command: each verb a model of its options, and the function that answers it."""

from mech_twin.process.dependencies import require_versions

require_versions()  # before anything of a verb, which would fail with a trace, is loaded
