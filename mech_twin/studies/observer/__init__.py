# SPDX-License-Identifier: Apache-2.0
"""Observer of a running machine: its state, forces and their uncertainty out of what sensors show.  Knows no ROS."""
