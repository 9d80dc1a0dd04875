# SPDX-License-Identifier: Apache-2.0
"""A real machine followed as it runs: its state estimated, judged, recorded, shown."""
