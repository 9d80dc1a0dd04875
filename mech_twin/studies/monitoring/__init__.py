# SPDX-License-Identifier: Apache-2.0
"""Monitoring: features once a cycle, a frozen baseline, charts with a stated rate of false alarms, named faults."""
