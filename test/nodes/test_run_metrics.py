# SPDX-License-Identifier: Apache-2.0
"""What a node gathers of a run stays small however long the run is."""

from __future__ import annotations

import pickle
import tracemalloc

from catalogue import built

from mech_twin.engine.run import frames
from mech_twin.studies.simulation import KEPT_EVENTS, RunMetrics

MOST_BYTES = 64 * 2**20


def test_the_events_of_a_long_run_weigh_less_than_64_mib() -> None:
    machine = built("mb10_breaker")
    metrics = RunMetrics(lambda: machine)
    for frame in frames(machine, 2.0):
        metrics.observe(frame)
    count, written = len(metrics.events), pickle.dumps(tuple(metrics.events))
    tracemalloc.start()
    try:
        copied = pickle.loads(written)  # the newest samples hold their events too, so a copy is weighed
        weight = tracemalloc.get_traced_memory()[0] / len(copied)
    finally:
        tracemalloc.stop()
    assert count > 200
    assert weight > 500.0  # an event has the state of every joint on both sides
    assert weight * KEPT_EVENTS < MOST_BYTES
