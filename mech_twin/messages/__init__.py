"""Samples to ROS messages and back."""
