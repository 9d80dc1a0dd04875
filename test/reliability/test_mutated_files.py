# SPDX-License-Identifier: Apache-2.0
"""A damaged map, baseline or linkage of one's own is what it was read as, or one line; what is accepted can be used."""

from __future__ import annotations

import json
import random
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mutations import mutated, mutated_tree

from mech_twin.cli.console import CommandError
from mech_twin.cli.monitor_baseline import read_setup
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.errors import MotionError
from mech_twin.nodes.shadow.inputs import followed_topics, sensed_channels
from mech_twin.parameters.load import machine_parameters
from mech_twin.results.opened_runs import configured_map
from mech_twin.studies.monitoring.cycle_features import FeatureVector
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup

pytestmark = pytest.mark.slow

ROOT = Path(__file__).resolve().parents[2]
SENSORS = sorted((ROOT / "benchmarks" / "monitoring" / "sensors").glob("*.yaml"))
MAPS = [*SENSORS, ROOT / "bags" / "weak_spring" / "map.yaml"]
BASELINE = ROOT / "bags" / "weak_spring" / "healthy.json"
BREAKER = "mb10_breaker"
MUTATIONS = 500  # of each kind
LONGEST_S = 10.0  # of the processor, for one file
LONGEST_LINE = 20_000


def refused(read: Callable[[], Any], file: Path) -> Any:
    """Return what was read, or None where it was refused in one line that names the file."""
    begun = time.process_time()
    try:
        return read()
    except (ConfigurationError, CommandError, MotionError) as error:
        line = str(error)
        assert isinstance(error, MotionError) or line.startswith(str(file))
        assert len(line) < LONGEST_LINE
        return None
    finally:
        assert time.process_time() - begun < LONGEST_S


def judged(setup: MonitorSetup, cycles: int, seed: int) -> None:
    """Judge cycles of which the later are off by some sigma."""
    monitor, baseline = Monitor(setup), setup.baseline
    random_ = np.random.default_rng(seed)
    for number in range(cycles):
        row = baseline.mean + baseline.sigma * (random_.standard_normal(len(baseline.names)) + 4.0 * (number > 20))
        found = monitor.observe(FeatureVector(number, number * 0.1, (number + 1) * 0.1, baseline.names, row))
        assert found.charts is None or not np.isnan(found.charts.statistics).any()


def test_a_damaged_baseline_is_a_setup_or_one_line(tmp_path: Path) -> None:
    chance, file = random.Random("baseline"), tmp_path / "healthy.json"
    content = BASELINE.read_bytes()
    tree = json.loads(content)
    parameters, given = machine_parameters(BREAKER, None, None), configured_map(BASELINE.parent / "map.yaml")
    accepted = 0
    for i in range(2 * MUTATIONS):
        file.write_bytes(mutated(content, chance) if i % 2 else json.dumps(mutated_tree(tree, chance)).encode())
        setup = refused(lambda: read_setup(file, BREAKER, parameters, given), file)
        if setup is not None:
            accepted += 1
            judged(setup, 40 if accepted <= 20 else 5, i)
    assert 0 < accepted < MUTATIONS


@pytest.mark.parametrize("map_file", MAPS, ids=lambda path: path.stem)
def test_a_damaged_map_is_a_map_or_one_line(map_file: Path, tmp_path: Path) -> None:
    chance, file = random.Random(f"map {map_file.name}"), tmp_path / "map.yaml"
    content = map_file.read_bytes()
    tree = yaml.safe_load(content)
    accepted = 0
    for i in range(MUTATIONS):
        file.write_bytes(mutated(content, chance) if i % 2 else yaml.safe_dump(mutated_tree(tree, chance)).encode())
        given = refused(lambda: configured_map(file), file)
        if given is None:
            continue
        accepted += 1
        try:
            sensed_channels(given)
            followed_topics(given, "/plant")
        except ConfigurationError as error:
            assert len(str(error)) < LONGEST_LINE
    assert 0 < accepted < MUTATIONS
