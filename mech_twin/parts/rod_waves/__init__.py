# SPDX-License-Identifier: Apache-2.0
"""Longitudinal waves in a chain of rods that a striker hits: ``chain`` (rods, contacts), ``blow`` (one blow)."""
