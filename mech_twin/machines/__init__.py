# SPDX-License-Identifier: Apache-2.0
"""One package a machine, what several share, and the catalogue."""
