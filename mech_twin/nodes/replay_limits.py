# SPDX-License-Identifier: Apache-2.0
"""Rates a replay can have; in a file of their own, so that the command line can judge one without ROS."""

SLOWEST, FASTEST = 0.001, 1000.0
