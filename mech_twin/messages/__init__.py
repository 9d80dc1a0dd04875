# SPDX-License-Identifier: Apache-2.0
"""Samples to ROS messages and back."""
