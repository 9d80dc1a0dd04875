# SPDX-License-Identifier: Apache-2.0
"""Work over a Dask cluster of two worker processes: one is killed, nothing is lost, nothing counted twice."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from mech_twin.errors import StudyError
from mech_twin.measurements.measurement_map import Channel, MeasurementMap
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies import designs, sweep
from mech_twin.studies.identification.fit_problem import problem_of
from mech_twin.studies.identification.fit_runs import ColumnCurves, FitChannel, FitRun, needed_columns
from mech_twin.studies.identification.intervals import linearised
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion
from mech_twin.studies.identification.refits import key_profiles
from mech_twin.studies.identification.staged_fit import stage_fits
from mech_twin.studies.monitoring.sensing import MonitoredMachine, seen_run
from mech_twin.studies.named_rollouts import rollout
from mech_twin.studies.parameter_sweep import journal_of

pytestmark = pytest.mark.slow
AXES = {"linkage.crank_m": tuple(0.04 + 0.0005 * i for i in range(40)), "drive.speed_rpm": (200.0, 300.0)}
QUIET = {**os.environ, "DASK_DISTRIBUTED__LOGGING__DISTRIBUTED": "error"}


def command(*arguments: object) -> list[str]:
    beside = Path(sys.executable).with_name("dask")
    return [str(beside if beside.exists() else shutil.which("dask")), *map(str, arguments)]


@contextmanager
def process(*arguments: object):
    with subprocess.Popen(
        command(*arguments), env=QUIET, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as running:
        try:
            yield running
        finally:
            if running.poll() is None:
                running.send_signal(signal.SIGTERM)
                try:
                    running.wait(10.0)
                except subprocess.TimeoutExpired:
                    running.kill()


@pytest.fixture
def cluster(tmp_path):
    from distributed import Client

    file = tmp_path / "scheduler.json"
    with ExitStack() as stack:
        stack.enter_context(
            process("scheduler", "--host", "127.0.0.1", "--port", 0, "--no-dashboard", "--scheduler-file", file)
        )
        until = time.monotonic() + 30.0
        while not file.exists():
            assert time.monotonic() < until
            time.sleep(0.05)
        worker = ("worker", "--scheduler-file", file, "--nthreads", 1, "--no-nanny", "--no-dashboard")
        workers = [stack.enter_context(process(*worker, "--host", "127.0.0.1")) for _ in range(2)]
        with Client(scheduler_file=str(file), set_as_default=False) as client:
            client.wait_for_workers(2, timeout=30.0)
            yield client.scheduler.address, workers


def test_a_killed_worker_loses_nothing_and_nothing_counts_twice(cluster, tmp_path):
    address, workers = cluster
    table, killed = tmp_path / "press.parquet", []
    lines = []

    def kill_one(done: int, total: int) -> None:
        lines.append(len(journal_of(table).read_text().splitlines()) - 1)
        assert lines[-1] == done
        if done > total // 5 and not killed:
            workers[0].send_signal(signal.SIGKILL)
            workers[0].wait(10.0)
            killed.append(done)

    outputs = ("stroke_m", "flywheel_inertia_kg_m2")
    asked = {"outputs": outputs, "picture": False}
    done = sweep("compaction_press", AXES, table, scheduler=address, progress=kill_one, **asked)
    assert killed
    assert killed[0] < 80
    assert lines[-1] == 80
    assert [point.index for point in done.points] == list(range(80))
    alone = sweep("compaction_press", AXES, tmp_path / "alone.parquet", cores=1, **asked)
    assert done.points == alone.points


def test_the_cluster_scans_the_same_designs_as_one_core(cluster):
    address, _ = cluster
    there, here = designs("compaction_press", 90_000, scheduler=address), designs("compaction_press", 90_000, cores=1)
    assert there.designs == here.designs == 90_000
    assert (there.feasible == here.feasible).all()


def left(address: str) -> tuple[int, int]:
    """Return the tasks that a scheduler still holds, and its workers."""
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        return client.run_on_scheduler(lambda dask_scheduler: (len(dask_scheduler.tasks), len(dask_scheduler.workers)))


def test_a_study_that_is_killed_leaves_nothing_to_do_and_the_cluster_to_others(cluster, tmp_path):
    address, workers = cluster
    table = tmp_path / "press.parquet"
    wide = {**AXES, "linkage.crank_m": tuple(0.04 + 0.00001 * i for i in range(2000))}
    asked = f"'compaction_press', {wide}, Path({str(table)!r}), scheduler={address!r}, picture=False"
    study = f"from pathlib import Path; from mech_twin.studies import sweep; sweep({asked})"
    with subprocess.Popen([sys.executable, "-c", study], stderr=subprocess.PIPE, text=True) as process:
        until = time.monotonic() + 60.0
        while left(address)[0] < 10:
            assert process.poll() is None, process.stderr.read()
            assert time.monotonic() < until
            time.sleep(0.1)
        process.kill()
    until = time.monotonic() + 60.0
    while left(address)[0]:
        assert time.monotonic() < until, "the scheduler still has tasks of a study that is gone"
        time.sleep(0.2)
    assert left(address) == (0, 2)
    assert all(worker.poll() is None for worker in workers)
    there, here = designs("compaction_press", 9_000, scheduler=address), designs("compaction_press", 9_000, cores=1)
    assert (there.feasible == here.feasible).all()


def test_a_scheduler_that_is_not_there_is_told_before_a_point_is_computed(tmp_path, monkeypatch):
    monkeypatch.setattr("mech_twin.studies.spreading.CONNECT_S", 1.0)
    with pytest.raises(StudyError, match="no connection"):
        sweep(
            "winding_drum", {"eccentricity_m": (0.0, 0.001, 0.002)}, tmp_path / "x.csv", scheduler="tcp://127.0.0.1:9"
        )
    assert list(tmp_path.iterdir()) == []


def measured_crank():
    """Return a run of another crank mechanism: its crank and its slider, each with noise."""
    true = machine_parameters("vibration_crank", None, {"crank_m": 0.131, "rod_m": 0.47})
    noises = {"linkage.crank.position": 0.002, "linkage.slider.position": 3e-4}
    curves = ColumnCurves(rollout("vibration_crank", 0.6, true, columns=needed_columns(list(noises))))
    random, times = np.random.default_rng(1), np.arange(0.0, 0.59, 0.005)
    channels = []
    for name, noise in noises.items():
        line = Channel.model_validate({"source": {"column": name}, "is": name, "sigma": noise, "zero": "free"})
        shown = curves.at(name, times) + noise * random.standard_normal(len(times))
        channels.append(FitChannel(line, times, shown, noise))
    return FitRun(Path("stand"), tuple(channels), (), 0.0)


def test_the_cluster_follows_the_same_profiles_and_ends_the_same_starts_as_one_core(cluster):
    address, _ = cluster
    # the working force has hardly an effect: its interval is wider than itself, so it is followed
    keys = ("crank_m", "rod_m", "working_force_n")
    base, runs = machine_parameters("vibration_crank"), (measured_crank(),)
    question = IdentificationQuestion("vibration_crank", base, keys, cores=1)
    problem = problem_of(question, runs)
    (fitted,) = stage_fits(problem, [problem.unknowns.start], 1.0)
    line = linearised(fitted)
    here, there = key_profiles(fitted, line), key_profiles(fitted, line, scheduler=address)
    ends = [[(each.place, each.lower, each.upper) for each in profiles] for profiles in (here, there)]
    assert not np.all(np.isnan(ends[0]))
    assert np.array_equal(*ends, equal_nan=True)
    start = problem.unknowns.start * 1.02
    ((far,), (near,)) = (stage_fits(problem, [start], 0.5, scheduler=each) for each in (address, None))
    assert np.array_equal(far.x, near.x)


def written_fleet(folder: Path) -> None:
    """Write two recordings of each of five impact masses; the stop of the last one moves before its second."""
    noises = {"motor.generator.effort": 20.0, "linkage.mass.position": 1e-3}
    lines = [{"source": {"column": c}, "is": c, "rate_hz": 1000.0, "sigma": sigma} for c, sigma in noises.items()]
    sensors = MeasurementMap.model_validate({"machine": "impact_mass", "channels": lines})
    mass = MonitoredMachine("impact_mass", machine_parameters("impact_mass"), sensors)
    moved = next(fault for fault in mass.faults if fault.name == "stop_moved")
    begin_s, healthy = mass.declared.run_up_s, mass.entry.build(mass.parameters)
    faulty = mass.entry.build(mass.varied(moved.changes(mass.parameters, moved.sizes[-1])))
    for number in range(5):
        own = folder / f"mass_{number}"
        own.mkdir(parents=True)
        for day, built in enumerate((healthy, faulty if number == 4 else healthy)):
            random = np.random.default_rng([number, day])
            seen = seen_run(built, sensors, begin_s + 15.0, random=random, begin_s=begin_s)
            times_s = seen["linkage.mass.position"][0] - begin_s
            table = pd.DataFrame({"time_s": times_s, **{column: values for column, (_, values) in seen.items()}})
            table.to_csv(own / f"day_{day}.csv", index=False)


@pytest.mark.timeout(1300)
def test_the_cluster_tells_the_same_of_a_fleet_as_this_machine(cluster, tmp_path):
    address, _ = cluster
    written_fleet(tmp_path / "hall")
    verb = [sys.executable, "-c", "from mech_twin.cli.main import main; main()", "fleet", "impact_mass"]
    verb += [str(tmp_path / "hall"), "--skip", "0", "--json"]
    done = [
        subprocess.run([*verb, *where], stdout=subprocess.PIPE, text=True, timeout=600.0, check=False)
        for where in (("--cores", "1"), ("--scheduler", address))
    ]
    assert done[0].returncode == done[1].returncode == 1
    assert done[0].stdout == done[1].stdout
    (first, *others) = json.loads(done[0].stdout)["machines"]
    assert (first["name"], first["verdict"]) == ("mass_4", "confirmed")
    assert not any(each["verdict"] for each in others)
