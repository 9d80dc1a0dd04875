# SPDX-License-Identifier: Apache-2.0
"""Identification of a machine's parameters from measured runs: fits, intervals, verdicts, and choice of sensors."""
