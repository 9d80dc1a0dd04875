"""Monitoring: features once a cycle, a frozen baseline, charts with a stated rate of false alarms, named faults."""
