# SPDX-License-Identifier: Apache-2.0
"""Measurements of a real machine: maps, recordings of other programs, tables, data quality, sensors."""
