# SPDX-License-Identifier: Apache-2.0
"""Shadow of a real machine as it runs: its state is estimated, monitored, recorded and shown."""
