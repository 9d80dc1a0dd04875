# SPDX-License-Identifier: Apache-2.0
"""YAML configuration to validated parameter models."""
