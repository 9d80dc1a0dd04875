# SPDX-License-Identifier: Apache-2.0
"""The tutorial docs/tutorials/weak-spring.md over real topics, from the first run to the figure that comes back.

    python benchmarks/monitoring/weak_spring.py FOLDER [--healthy-s 40] [--pictures]

A breaker with hidden parameters runs in another process; its sensors, noisy, and its control, which takes a preload,
are another one.  It is recorded, identified, watched; its spring weakens, which nobody tells; the operator acknowledges
the fault and accepts the advice.  Times are the machine's, so a busy computer makes it slower and nothing else.  A
recording or a configuration that is in the folder already is not made again.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.srv import SetParameters
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from mech_twin.messages.cdr import Header, StepMessage, encoded, received_message
from mech_twin.messages.topics import (
    DATA,
    DECISIONS,
    DIAGNOSTICS,
    LATCHED,
    RECOMMENDATION,
    STANDARD_RESIDUALS,
    full_name,
)
from mech_twin.nodes.exchange.spinner import Spinner
from mech_twin.nodes.run.domain import settle_domain

HERE = Path(__file__).resolve()
NAME, FIGURE = "mb10_breaker", "body_mean_rad"
HIDDEN = ("body.inertia_kg_m2=6.4", "tool.restitution=0.36")
SPRING, PRELOAD = "body.spring_rate_n_per_m", "body.preload_deflection_m"
WEAK, USUAL_PRELOAD_M = 0.8 * 53300.0, 0.0139
HIDDEN_NAMESPACE = "hidden"
SETTINGS = f"/{HIDDEN_NAMESPACE}/linkage/set_parameters"
SENSORS, RATE_HZ = "/plant/sensors", 200.0
PARTS = {"joint_states": ("crank", 1e-3), "motor/joint_states": ("rotor", 0.2), "body/joint_states": ("body", 5e-4)}
MAP = """machine: mb10_breaker
channels:
  - {source: {topic: sensors, joint: crank, field: position}, is: linkage.crank.position, sigma: 0.001}
  - {source: {topic: sensors, joint: rotor, field: effort}, is: motor.rotor.effort, sigma: 0.2}
  - {source: {topic: sensors, joint: body, field: position}, is: body.body.position, sigma: 0.0005}
"""
WISH = """figure: body_mean_rad         # how far off its seat the body is, the mean of a turn
wanted: {wanted:.6g}
output: {{key: body.preload_deflection_m, low: 0.010, high: 0.022, value: 0.0139}}
step_share: 0.5
cycles: 20
interval_s: 5.0
settling_cycles: 15
trial_cycles: 20
dry_run: false
"""
BEFORE_S, AFTER_S = 6.0, 2.0  # of the story, in the shortened recording
LISTENERS = 2  # operator and shadow
LIMIT_S = 1800.0  # of the wall clock, for anything that is waited for


def command(*words: object) -> list[str]:
    """Return a command of the twin."""
    return [sys.executable, "-m", "mech_twin", *map(str, words)]


def run(*words: object) -> None:
    """Run a command to its end, showing it; without its result the story cannot go on."""
    print("$ mech-twin", *words, flush=True)
    if subprocess.run(command(*words), check=False, timeout=LIMIT_S).returncode != 0:
        raise SystemExit(1)


@contextmanager
def beside(words: list[str], shown: bool = True) -> Iterator[subprocess.Popen[bytes]]:
    """Run a command until the block ends."""
    if shown:
        print("$ mech-twin", *words[3:], "&", flush=True)
    with subprocess.Popen(words) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(LIMIT_S)


def sensors() -> None:
    """Show what noisy sensors make of the machine's joints, all of an instant in one message; until a signal.

    The control beside them passes a preload on, and no other parameter.
    """
    settle_domain()
    rclpy.init(args=[])
    node, random = rclpy.create_node("sensors"), np.random.default_rng(3)
    control = rclpy.create_node("linkage", namespace="plant")
    control.declare_parameter(PRELOAD, USUAL_PRELOAD_M)
    machine = node.create_client(SetParameters, SETTINGS)

    def pass_on(changed: list[Parameter]) -> None:
        machine.call_async(SetParameters.Request(parameters=[each.to_parameter_msg() for each in changed]))

    control.add_post_set_parameters_callback(pass_on)
    out = node.create_publisher(JointState, SENSORS, DATA)
    waiting: dict[Any, dict[str, float]] = {}

    def on_joints(part: str, raw: bytes) -> None:
        joint, sigma = PARTS[part]
        message = received_message(raw)
        place, field = message.name.index(joint), "effort" if joint == "rotor" else "position"
        seen = waiting.setdefault(message.header.stamp, {})
        seen[joint] = float(getattr(message, field)[place] + sigma * random.standard_normal())
        if len(seen) == len(PARTS):
            del waiting[message.header.stamp]
            zeros = (0.0, 0.0, 0.0)
            efforts, positions = (0.0, seen["rotor"], 0.0), (seen["crank"], 0.0, seen["body"])
            header = Header(message.header.stamp)
            out.publish(encoded(StepMessage(header, ("crank", "rotor", "body"), positions, zeros, efforts)))
            for old in sorted(waiting)[:-20]:
                del waiting[old]

    for part in PARTS:
        node.create_subscription(
            JointState, f"/{HIDDEN_NAMESPACE}/{part}", lambda raw, part=part: on_joints(part, raw), DATA, raw=True
        )
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.add_node(control)
        executor.spin()


def plant(*words: object) -> list[str]:
    """Return the command of the machine with hidden parameters."""
    settings = [word for pair in (*HIDDEN, f"run.stream_rate_hz={RATE_HZ}") for word in ("--set", pair)]
    return command("run", NAME, "--namespace", HIDDEN_NAMESPACE, "--no-record", "--view", "none", *settings, *words)


class Operator:
    """Hears the machine and its shadow, and answers."""

    def __init__(self) -> None:
        self.node, self.clock_s = rclpy.create_node("operator"), 0.0
        self.faults: dict[str, str] = {}
        self.decisions: list[str] = []
        self.offer: DiagnosticStatus | None = None
        self.diary: list[tuple[float, str]] = []
        create = self.node.create_subscription
        create(JointState, SENSORS, self._on_sensors, DATA, raw=True)
        create(DiagnosticArray, DIAGNOSTICS.name, self._on_diagnostics, DATA)
        create(DiagnosticStatus, full_name(NAME, DECISIONS), self._on_decision, DATA)
        create(DiagnosticStatus, full_name(NAME, RECOMMENDATION), self._on_offer, LATCHED)
        self.spinner = Spinner([self.node])

    def note(self, text: str) -> None:
        """Write a line into the diary."""
        self.diary.append((self.clock_s, text))
        print(f"{self.clock_s:9.2f} s  {text}", flush=True)

    def _on_sensors(self, raw: bytes) -> None:
        stamp = received_message(raw).header.stamp
        self.clock_s = stamp.sec + 1e-9 * stamp.nanosec

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            who, _, name = status.name.partition(": ")
            if who.endswith("/monitor") and name and self.faults.get(name) != status.message:
                self.faults[name] = status.message
                found = next((v.value for v in status.values if v.key == "candidates"), "")
                self.note(f"{name}: {status.message}" + (f" [{found}]" if found else ""))

    def _on_decision(self, status: DiagnosticStatus) -> None:
        self.decisions.append(status.message)
        self.note(f"advisor: {status.message}")

    def _on_offer(self, status: DiagnosticStatus) -> None:
        self.offer = status

    def until(self, predicate: Callable[[], bool], what: str) -> None:
        """Spin until something holds.

        Raises
        ------
        TimeoutError
            It did not happen.
        """
        end = time.monotonic() + LIMIT_S
        self.spinner.until(lambda: predicate() or time.monotonic() > end)
        if not predicate():
            raise TimeoutError(f"{what}: not within {LIMIT_S:g} s")

    def runs(self, seconds: float) -> None:
        """Let the machine run for a time of its own."""
        end_s = self.clock_s + seconds
        self.until(lambda: self.clock_s >= end_s, f"the machine at {end_s:g} s")

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Call a service and return its answer."""
        client = self.node.create_client(kind, service)
        self.until(client.service_is_ready, service)
        future = client.call_async(request)
        self.until(future.done, service)
        return future.result()

    def said(self, word: str) -> bool:
        """Return whether the newest decision is this one."""
        return bool(self.decisions) and self.decisions[-1].startswith(word)


@contextmanager
def listening(operator: Operator, name: str, *words: str) -> Iterator[None]:
    """Follow and record the machine's sensors; the block begins when the shadow listens."""
    asked = command("shadow", NAME, "--from", "plant", "--map", "map.yaml", "--record", name, "--force", *words)
    with beside(asked):
        operator.until(lambda: operator.node.count_subscribers(SENSORS) >= LISTENERS, f"the shadow of {name}")
        yield
    operator.until(lambda: operator.node.count_subscribers(SENSORS) < LISTENERS, f"the end of {name}")


def story(healthy_s: float) -> None:
    """Do all of it in the working directory."""
    Path("map.yaml").write_text(MAP, encoding="utf-8")
    settle_domain()
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    operator = Operator()
    with ExitStack() as at_end:
        at_end.enter_context(beside([sys.executable, str(HERE), "--sensors"], shown=False))
        if not Path("start").exists():
            with listening(operator, "start"), beside(plant()):
                operator.until(lambda: operator.clock_s >= 4.0, "the first four seconds")
            operator.clock_s = 0.0
        if not Path("found").exists():
            free = ("--free", "body.inertia_kg_m2", "--free", "tool.restitution")
            run("identify", NAME, "start", "--map", "map.yaml", *free, "--out", "found")
        at_end.enter_context(beside(plant("--pace", "realtime")))
        operator.until(lambda: operator.clock_s >= 3.0, "the run-up")
        config = ("--config", f"found/{NAME}.yaml")
        if not Path("healthy").exists():
            with listening(operator, "healthy", *config):
                operator.runs(healthy_s)
        run(
            "monitor", NAME, "healthy", "--map", "map.yaml", *config, "--baseline", "healthy", "--arl0", "0.5",
            "--skip", "0.5", "--save-baseline", "healthy.json", "--force",
        )  # fmt: skip
        healthy = json.loads(Path("healthy.json").read_text(encoding="utf-8"))["operating"]
        wanted = healthy["mean"][healthy["names"].index(FIGURE)]
        Path("wish.yaml").write_text(WISH.format(wanted=wanted), encoding="utf-8")
        watch = ("--monitor", "healthy.json", "--black-box", "faults", "--advise", "wish.yaml")
        at_end.enter_context(listening(operator, "watched", *config, *watch))
        operator.runs(12.0)
        weakened(operator)
    operator.node.destroy_node()
    rclpy.try_shutdown()
    Path("diary.json").write_text(json.dumps({"wanted": wanted, "diary": operator.diary}), encoding="utf-8")


def weakened(operator: Operator) -> None:
    """Weaken the spring, and do what an operator does."""
    change = Parameter(SPRING, value=WEAK).to_parameter_msg()
    answer = operator.call(SetParameters, SETTINGS, SetParameters.Request(parameters=[change]))
    assert answer.results[0].successful, answer.results[0].reason
    operator.note(f"the spring weakens: {SPRING} = {WEAK:g}")
    operator.until(lambda: "active" in operator.faults.values(), "the fault")
    operator.runs(9.0)
    operator.offer = None
    operator.note(operator.call(Trigger, f"/{NAME}/monitor/acknowledge", Trigger.Request()).message)
    operator.until(lambda: operator.said("offered") and operator.offer is not None, "an advice")
    if operator.offer is not None:
        operator.note("; ".join(f"{v.key} {v.value}" for v in operator.offer.values if v.key != "evidence"))
    operator.note(operator.call(SetBool, f"/{NAME}/advisor/accept", SetBool.Request(data=True)).message)
    operator.until(lambda: operator.said("kept") or operator.said("reverted"), "the end of the trial")
    operator.runs(5.0)


def shortened(folder: Path, out: Path) -> None:
    """Write what was measured and said once a cycle, from a little before the spring weakens on, and what judges it."""
    from mech_twin.recording.bag_reader import open_bag
    from mech_twin.recording.bag_writer import BagWriter

    topics = [
        SENSORS,
        *(full_name(NAME, each) for each in (STANDARD_RESIDUALS, DECISIONS, RECOMMENDATION, DIAGNOSTICS)),
    ]
    diary = json.loads((folder / "diary.json").read_text(encoding="utf-8"))["diary"]
    first_ns = round(1e9 * (next(at for at, text in diary if "weakens" in text) - BEFORE_S))
    last_ns = round(1e9 * (max(at for at, text in diary if text.startswith("advisor: ")) + AFTER_S))
    with open_bag(folder / "watched") as reader:
        messages = [each for each in reader.messages(topics) if first_ns <= each.log_time_ns <= last_ns]
        schemas = {topic: about.type_name for topic, about in reader.topics.items() if topic in topics}
    config = folder / "found" / f"{NAME}.yaml"
    writer = BagWriter(out / "watched", configuration=config.read_text(encoding="utf-8"))
    for topic, kind in schemas.items():
        writer.add_topic(topic, kind)
    for each in messages:
        writer.write(each.topic, each.raw, each.log_time_ns, each.publish_time_ns)
    writer.close()
    for file in (config, folder / "map.yaml", folder / "healthy.json"):
        shutil.copy(file, out)


def pictures(folder: Path, out: Path) -> None:
    """Draw the figure of each cycle and the charts, from the recording."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    from mech_twin.measurements.measurement_map import read_map
    from mech_twin.measurements.runs import read_run
    from mech_twin.parameters.load import catalogue_entry, machine_parameters
    from mech_twin.results.opened_runs import columns_of, opened_run
    from mech_twin.studies.monitoring.cycle_features import FeatureFeed, feed_channels
    from mech_twin.studies.monitoring.monitor import Monitor
    from mech_twin.studies.monitoring.setup_record import SETUP

    given = read_map(folder / "map.yaml", columns_of)
    with opened_run(folder / "watched") as reader:
        run = read_run(reader, given)
    ask = catalogue_entry(NAME).capabilities.features
    assert ask is not None
    channels = {channel.name: (channel.times_s, channel.values) for channel in run.channels}
    vectors = feed_channels(FeatureFeed(ask(machine_parameters(NAME)), list(channels)), channels)
    setup = SETUP.validate_json((folder / "healthy.json").read_bytes())
    monitor, written = Monitor(setup), json.loads((folder / "diary.json").read_text(encoding="utf-8"))
    found = [monitor.observe(vector) for vector in vectors]
    times = np.array([vector.end_s for vector in vectors])
    figure, (upper, lower) = plt.subplots(2, 1, sharex=True, figsize=(9.0, 5.2), layout="constrained")
    values = [1e3 * vector.values[vector.names.index(FIGURE)] for vector in vectors]
    upper.plot(times, values, ".", ms=3, color="tab:blue")
    upper.axhline(1e3 * written["wanted"], color="tab:green", lw=1, label="wanted")
    upper.set_ylabel("body off its seat, mrad")
    charts = np.array([[np.nan] * 3 if f.charts is None else f.charts.statistics for f in found])
    for column, (name, limit) in enumerate(zip(("cusum", "glr", "chi-square"), setup.limits.alarm, strict=True)):
        lower.semilogy(times, np.maximum(charts[:, column] / limit, 1e-2), lw=1, label=name)
    lower.axhline(1.0, color="black", lw=1, ls="--")
    lower.set_ylabel("statistic over its threshold")
    lower.set_xlabel("the machine's time, s")
    marks = (("the spring weakens", "spring"), ("acknowledged", "yes: seen"), ("accepted", "yes: preload"))
    for word, label in marks:
        at_s = next((at for at, text in written["diary"] if word in text), None)
        for axes in (upper, lower):
            if at_s is not None:
                axes.axvline(at_s, color="tab:red", lw=1)
        if at_s is not None:
            upper.annotate(label, (at_s, upper.get_ylim()[1]), ha="left", va="top", fontsize=9, rotation=90)
    upper.legend(loc="center right")
    lower.legend(loc="center right")
    figure.savefig(out, dpi=110)


def main(words: Sequence[str]) -> None:
    """Do what is asked."""
    asked = argparse.ArgumentParser(description="a spring weakens: found, named, advised, and the figure comes back")
    asked.add_argument("folder", type=Path, nargs="?")
    asked.add_argument("--healthy-s", type=float, default=40.0, help="healthy time that is recorded, s")
    asked.add_argument("--pictures", type=Path, help="only draw the run of the folder, into this file")
    asked.add_argument("--bag", type=Path, help="only shorten the recording of the folder, into this one")
    asked.add_argument("--sensors", action="store_true", help=argparse.SUPPRESS)
    given = asked.parse_args(words)
    if given.sensors:
        sensors()
    elif given.folder is None:
        asked.error("FOLDER: expected a folder for the run")
    elif given.bag:
        shortened(given.folder, given.bag)
    elif given.pictures:
        pictures(given.folder, given.pictures)
    else:
        given.folder.mkdir(parents=True, exist_ok=True)
        os.chdir(given.folder)
        story(given.healthy_s)


if __name__ == "__main__":
    main(sys.argv[1:])
