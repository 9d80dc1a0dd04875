# SPDX-License-Identifier: Apache-2.0
"""Replay of a recording on its topics."""

SLOWEST, FASTEST = 0.001, 1000.0  # rates; here, so that the command line can check them without loading ROS
