# SPDX-License-Identifier: Apache-2.0
"""Errors and coverage of `identify`, lmfit and MuJoCo's system identification on the same data.

    python benchmarks/identification/peers.py [--repeats N] [--memory A] [--write]

A crank mechanism measured by the angle of its wheel (zero unknown) and the position of its slide.  All fit the same
keys and the same zero, with the same roll-outs and the noise that the sensors are known to have; the peers by single
shooting with finite differences.  With ``--memory`` the noise of each sensor follows an autoregression of first order,
as a filter in it would make it, of the same size.
Needs the extra 'bench'.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from evidence import share_interval, write_rows

try:
    import lmfit
    import mujoco
    from mujoco_peer import sysid_answer
except ModuleNotFoundError as error:
    sys.exit(f"peers.py needs {error.name}; install the extra 'bench'")

import mech_twin
from mech_twin.measurements.measurement_map import Channel
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies.identification.fit_runs import ColumnCurves, FitChannel, FitRun, needed_columns
from mech_twin.studies.identification.identification import identified
from mech_twin.studies.identification.keyed_configuration import IdentificationQuestion, KeyedConfiguration

MACHINE, DURATION_S, ZERO, STEP_S = "vibration_crank", 1.2, 0.3, 0.008
TRUE = {"crank_m": 0.131, "rod_m": 0.47}
NOISES = {"linkage.crank.position": 0.002, "linkage.slider.position": 3e-4}
HEADS = ("noise", "tool", "key", "repeats", "rms error", "standard error, mean", "held", "95 % of it", "s each")
Answer = dict[str, tuple[float, float, float, float]]  # key: estimate, standard error, and the ends of its interval


@dataclass(frozen=True)
class Data:
    """One measurement: instants, and what each sensor showed."""

    times_s: np.ndarray
    shown: dict[str, np.ndarray]


def measured(seed: int, memory: float) -> Data:
    """Return a measurement of the true machine."""
    random = np.random.default_rng(seed)
    keyed = KeyedConfiguration(MACHINE, machine_parameters(MACHINE), tuple(TRUE))
    times = np.arange(0.0, DURATION_S - STEP_S, STEP_S)
    curves = curves_of(keyed, np.array(list(TRUE.values())))
    shown = {}
    for name, noise in NOISES.items():
        white = random.standard_normal(len(times))
        for i in range(1, len(times)):
            white[i] = memory * white[i - 1] + np.sqrt(1.0 - memory**2) * white[i]
        shown[name] = curves.at(name, times) + noise * white
    shown["linkage.crank.position"] += ZERO
    return Data(times, shown)


def curves_of(keyed: KeyedConfiguration, values: np.ndarray) -> ColumnCurves:
    """Return the run of the machine with these values."""
    run = mech_twin.rollout(MACHINE, DURATION_S, keyed.parameters(values), columns=needed_columns(list(NOISES)))
    return ColumnCurves(run)


def ours(data: Data) -> Answer:
    """Return what `identify` finds."""
    channels = []
    for name, noise in NOISES.items():
        zero = "free" if name == "linkage.crank.position" else 0.0
        line = Channel.model_validate({"source": {"column": name}, "is": name, "sigma": noise, "zero": zero})
        channels.append(FitChannel(line, data.times_s, data.shown[name], noise))
    run = FitRun(Path("peer"), tuple(channels), (), 0.0)
    question = IdentificationQuestion(MACHINE, machine_parameters(MACHINE), tuple(TRUE), cores=1)
    found = identified(question, [run])
    return {key.key: (key.estimate, key.standard_error, key.low_95, key.high_95) for key in found.keys}


def theirs(data: Data) -> Answer:
    """Return what lmfit's least squares finds from the same start; its interval is 1.96 standard errors."""
    keyed = KeyedConfiguration(MACHINE, machine_parameters(MACHINE), tuple(TRUE))
    unknowns = lmfit.Parameters()
    for place, value in enumerate(keyed.values().tolist()):
        unknowns.add(f"key{place}", value=value, min=0.05 * value, max=20.0 * value)
    unknowns.add("zero", value=0.0)

    def residuals(asked: lmfit.Parameters) -> np.ndarray:
        curves = curves_of(keyed, np.array([asked[f"key{place}"].value for place in range(len(TRUE))]))
        off = [(data.shown[name] - curves.at(name, data.times_s)) / noise for name, noise in NOISES.items()]
        off[0] -= asked["zero"].value / NOISES["linkage.crank.position"]
        return np.concatenate(off)

    found = lmfit.minimize(residuals, unknowns, method="leastsq").params
    told = [(found[f"key{place}"].value, found[f"key{place}"].stderr or np.nan) for place in range(len(TRUE))]
    return {
        key: (value, error, value - 1.96 * error, value + 1.96 * error)
        for key, (value, error) in zip(TRUE, told, strict=True)
    }


def mujocos(data: Data) -> Answer:
    """Return what MuJoCo's system identification finds from the same start, with its own intervals."""
    keyed = KeyedConfiguration(MACHINE, machine_parameters(MACHINE), tuple(TRUE))
    start = dict(zip(TRUE, keyed.values().tolist(), strict=True))

    def shown(values: np.ndarray) -> np.ndarray:
        curves = curves_of(keyed, values)
        return np.column_stack([curves.at(name, data.times_s) for name in NOISES])

    measured_columns = np.column_stack([data.shown[name] for name in NOISES])
    return sysid_answer(start, data.times_s, measured_columns, tuple(NOISES.values()), shown)


def rows_of(noise: str, tool: str, answers: list[Answer], seconds: float) -> Iterator[tuple[object, ...]]:
    """Yield a row a key."""
    for key, true in TRUE.items():
        found = np.array([answer[key] for answer in answers])
        error, deviation = float(np.sqrt(np.mean((found[:, 0] - true) ** 2))), float(np.mean(found[:, 1]))
        held = int(np.sum((found[:, 2] <= true) & (true <= found[:, 3])))
        low, high = share_interval(held, len(answers))
        share = (f"{100.0 * held / len(answers):.1f} %", f"{low:.1f} to {high:.1f}")
        each = f"{seconds / len(answers):.2f}"
        yield (noise, tool, key, len(answers), f"{error:.2e}", f"{deviation:.2e}", *share, each)


def main() -> None:
    words = argparse.ArgumentParser()
    words.add_argument("--repeats", type=int, default=200)
    words.add_argument("--memory", type=float, default=0.0)
    words.add_argument("--write", action="store_true", help="into docs/proof/identification.md")
    asked = words.parse_args()
    noise = f"memory {asked.memory:g}" if asked.memory else "white"
    rows: list[tuple[object, ...]] = []
    tools = {
        "mech_twin": ours,
        f"lmfit {lmfit.__version__}": theirs,
        f"MuJoCo {mujoco.__version__}": mujocos,
    }
    for tool, solve in tools.items():
        began = time.process_time()
        answers = [solve(measured(seed, asked.memory)) for seed in range(asked.repeats)]
        rows += rows_of(noise, tool, answers, time.process_time() - began)
    for row in [HEADS, *rows]:
        print(*row, sep="; ")
    if asked.write:
        write_rows("peers", HEADS, rows)


if __name__ == "__main__":
    main()
