# SPDX-License-Identifier: Apache-2.0
"""The identifier of a shadow: fed sample by sample it finds a hidden mass, and the model goes on with it on request."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
from bench_run import ShadowBench
from catalogue import built
from rclpy.parameter import Parameter

from mech_twin.declarations.configuration_tree import (
    ConfigurationError,
    configuration_tree,
    merged_tree,
    tree_from_flat,
)
from mech_twin.engine.rollout import roll_out
from mech_twin.measurements.measurement_map import MeasurementMap
from mech_twin.nodes.shadow.identifier_node import IdentifierNode
from mech_twin.nodes.shadow.session import Company, FreeKeys
from mech_twin.nodes.shadow.shadow_node import ShadowNode
from mech_twin.parameters.load import catalogue_entry, validated
from mech_twin.studies.observer.estimate import SeenSample
from mech_twin.studies.observer.observer import PhaseLockedObserver

NAME, KEY, HIDDEN = "vibration_crank", "masses.extra_kg", 9.0
SIGMA = {"linkage.crank.position": 1e-3, "linkage.crank.effort": 2.0}
LIMIT_S = 240.0
MAP = MeasurementMap.model_validate(
    {
        "machine": NAME,
        "channels": [
            {"source": {"topic": "joint_states", "joint": "crank", "field": column.rpartition(".")[2]}}
            | {"is": column, "sigma": sigma}
            for column, sigma in SIGMA.items()
        ],
    }
)


@pytest.fixture
def shadowed() -> Iterator[tuple[ShadowNode, IdentifierNode]]:
    """Provide a shadow and its identifier, wired as in a session; nothing spins them."""
    with ShadowBench(NAME, MAP, Company(free=FreeKeys((KEY,), {}))) as bench:
        yield bench.shadow, bench.of(IdentifierNode)


def seen(duration_s: float) -> Iterator[SeenSample]:
    """Yield what the sensors of a machine with the hidden mass show."""
    tree = merged_tree(configuration_tree(built(NAME).parameters), tree_from_flat({KEY: HIDDEN}))
    entry = catalogue_entry(NAME)
    run = roll_out(entry.build(validated(entry, tree, "hidden")), duration_s)
    random = np.random.default_rng(5)
    for row in range(0, len(run["time_s"]), 20):
        values = tuple(float(run[name][row] + sigma * random.standard_normal()) for name, sigma in SIGMA.items())
        yield SeenSample(float(run["time_s"][row]), (0, 1), values)


def test_what_cannot_be_done_is_refused_in_words(shadowed) -> None:
    _, identifier = shadowed
    is_done, message = identifier.identify()
    assert (is_done, "at least 20 samples" in message) == (False, True)
    assert identifier.take_over() == (False, "nothing is found that foretells better than before")
    (judged,) = identifier.set_parameters([Parameter("span_s", value=1e4)])
    assert not judged.successful
    assert judged.reason == "Parameter span_s out of range Min: 2.0, Max: 300.0, value: 10000.0"


def test_a_key_that_the_machine_does_not_have_is_refused(ros: None) -> None:
    with pytest.raises(ConfigurationError, match=r"masses\.nothing_kg"):
        IdentifierNode(NAME, MAP.channels, ("masses.nothing_kg",), {})


@pytest.mark.slow
def test_a_hidden_mass_is_found_and_shadow_and_description_go_on_with_it(shadowed) -> None:
    shadow, identifier = shadowed
    samples = list(seen(8.0))
    for sample in samples:
        for observe in shadow.at_sample:
            observe(sample)
        shadow.observer.take(sample)
    assert identifier.recent.span_s == pytest.approx(8.0, abs=0.05)
    identifier.set_parameters([Parameter("span_s", value=4.0)])
    assert identifier.identify()[1] == "1 keys, the last 4 s"
    assert not identifier.identify()[0], "one fit at a time"
    before, lines, end = shadow.observer, set(), time.monotonic() + LIMIT_S
    while identifier.phase == "running" and time.monotonic() < end:
        identifier.check_peers(time.monotonic())
        lines.add(identifier.status_line)
        time.sleep(0.02)
    assert identifier.phase == "found", identifier.status_line
    assert len(lines) > 2
    (key,) = identifier.found.keys
    assert key.low_95 < HIDDEN < key.high_95
    assert KEY in identifier.diagnostic_values()
    assert identifier.take_over()[0]
    assert shadow.observer is not before
    assert configuration_tree(identifier.model)["masses"]["extra_kg"] == key.estimate
    assert not identifier.take_over()[0], "it is taken over once"
    old = PhaseLockedObserver(built(NAME), catalogue_entry(NAME).build, before.channels)
    misses = [
        [abs(e.innovations[1]) for s in samples if (e := each.take(s)) is not None] for each in (old, shadow.observer)
    ]
    assert len(misses[1]) > 100
    assert np.median(misses[1]) < np.median(misses[0])


def test_the_diagnostics_of_an_identifier_have_the_time_of_the_machine(shadowed) -> None:
    shadow, identifier = shadowed
    shadow.origin.second = 1_790_000_000
    for observe in shadow.at_sample:
        observe(SeenSample(3.5, (0, 1), (0.1, 0.0)))
    assert identifier.time_s == 1_790_000_003.5


def test_a_fit_whose_process_is_killed_is_told_as_failed(shadowed) -> None:
    _, identifier = shadowed
    for row in range(400):
        identifier.observe(SeenSample(0.02 * row, (0, 1), (0.1 * row, 0.0)))
    assert identifier.identify()[0]
    identifier._fit._process.kill()
    end = time.monotonic() + 60.0
    while identifier.phase == "running" and time.monotonic() < end:
        identifier.check_peers(time.monotonic())
        time.sleep(0.02)
    assert (identifier.phase, identifier.status_line) == ("failed", "the fit ended with code -9")
    assert identifier.identify()[0], "another may be asked for"
