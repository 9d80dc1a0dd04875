# SPDX-License-Identifier: Apache-2.0
"""Monitoring: features of each cycle, a frozen baseline, control charts with a set false-alarm rate, diagnosis."""
