# SPDX-License-Identifier: Apache-2.0
"""Lengths of a real slider-crank from three runs: keys, lag and score, beside what an independent fit found.

    python benchmarks/identification/crank_rig.py DIRECTORY

The directory holds run_5.5V.tsv, run_7.5V.tsv and run_9.5V.tsv of the public repository Noah-Abeson/2003LocoMotive;
it is not part of this project.  Their first column counts samples; when they were taken is the sum of the last one, in
ms.  Ends with exit code 1 where the run held out fits to less than 98.5 %.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml
from data_directory import given_directory

from mech_twin.measurements.runs import read_run
from mech_twin.parameters.load import machine_parameters
from mech_twin.results.opened_runs import configured_map, opened_run
from mech_twin.studies.identification.geometry_fit import GeometryModel, geometry_data, geometry_report

RUNS = ("run_5.5V.tsv", "run_7.5V.tsv", "run_9.5V.tsv")
KEYS = ("crank_m", "rod_m", "offset_m")
INDEPENDENT = {
    "crank_m": 0.07713,
    "rod_m": 0.2558,
    "offset_m": -0.1525,
}  # the slide runs below the crank, on its other side
TAPE_MEASURE = {"slider": "below", "crank_m": 0.075, "rod_m": 0.254, "offset_m": -0.153}
LEAST_FIT_PERCENT = 98.5
SLIDE = "linkage.slider.position"
MAP = {
    "machine": "vibration_crank",
    "time": {"column": "time (s)"},
    "channels": [
        {
            "source": {"column": "wheel"},
            "is": "linkage.crank.position",
            "unit": "deg",
            "zero": "per_run",
        },
        {
            "source": {"column": "slide"},
            "is": SLIDE,
            "unit": "mm",
            "zero": "free",
            "lag_s": "free",
        },
    ],
}


def _timed(path: Path, scratch: Path) -> Path:
    """Return a table of wheel and slide over the times at which they were sampled."""
    rows = np.loadtxt(path, delimiter="\t", skiprows=1, usecols=range(6))
    out = scratch / path.with_suffix(".csv").name
    shown = np.column_stack([np.cumsum(rows[:, 5]) / 1e3, rows[:, 1], rows[:, 2]])
    np.savetxt(out, shown, delimiter=",", header="time (s),wheel,slide", comments="")
    return out


def main() -> None:
    """Print what each choice of a run held out finds."""
    folder = given_directory(__doc__, RUNS)
    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "map.yaml"
        file.write_text(yaml.safe_dump(MAP), encoding="utf-8")
        given = configured_map(file)
    base = machine_parameters("vibration_crank", None, TAPE_MEASURE)
    model = GeometryModel("vibration_crank", base, KEYS, columns=(SLIDE,))
    worst = 100.0
    scratch = tempfile.mkdtemp()
    for out in range(len(RUNS)):
        data = []
        for name in RUNS:
            with opened_run(_timed(folder / name, Path(scratch))) as reader:
                data.append(geometry_data(read_run(reader, given), model.columns))
        kept = [each for i, each in enumerate(data) if i != out]
        report, _ = geometry_report(model, kept, data[out], ("slider",))
        (score,) = report.held_out
        worst = min(worst, score.fit_percent)
        print(f"held out {RUNS[out]}: fit {score.fit_percent:.2f} %, before {score.before_percent:.2f} %")
        for key in report.keys:
            found = f"{1e3 * key.estimate:.2f} mm [{1e3 * key.low_95:.2f}, {1e3 * key.high_95:.2f}]"
            print(f"  {key.key}: {found}, {1e3 * INDEPENDENT[key.key]:.2f} by an independent fit; {key.verdict}")
        print(f"  lag of the slide {1e3 * report.lags_s[0]:.2f} ms", flush=True)
    sys.exit(int(worst < LEAST_FIT_PERCENT))


if __name__ == "__main__":
    main()
