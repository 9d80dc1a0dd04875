"""YAML configuration to validated parameter models."""
