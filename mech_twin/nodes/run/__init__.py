# SPDX-License-Identifier: Apache-2.0
"""A run from start to end: in one process or several, its names, its terminal, commands to its nodes."""
