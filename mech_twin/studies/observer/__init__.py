# SPDX-License-Identifier: Apache-2.0
"""Observer of a running machine: estimates state, forces and their uncertainty from sensors.  Independent of ROS."""
