# SPDX-License-Identifier: Apache-2.0
"""Conversion between samples and ROS messages."""
