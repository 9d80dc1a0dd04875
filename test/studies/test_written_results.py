# SPDX-License-Identifier: Apache-2.0
"""Results are complete or not there: a disk that fills up in the middle leaves what stood there before."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

# the limit on a file's size is the disk that fills up: a write beyond it fails in the middle of the file
PROGRAM = """
import resource, signal, sys
from pathlib import Path
import numpy as np
from mech_twin.files.output_file import OutputError
from mech_twin.parameters.load import machine_parameters
from mech_twin.parameters.written_configuration import write_configuration
from mech_twin.studies.design_scan import DesignScan
from mech_twin.studies.sweep_table import Point, question
from mech_twin.studies.sweep_table import write_table

kind, path = sys.argv[1], Path(sys.argv[2])
asked = question("winding_drum", machine_parameters("winding_drum"), {"eccentricity_m": (0.0, 0.001)})
points = [Point(index, {f"number_{n}": 0.1 * n for n in range(400)}, "") for index in range(2)]
scan = DesignScan(**{**dict.fromkeys(DesignScan.__dataclass_fields__, 1), "variables": ("a",), "objectives": {"b": 1.0},
                     "feasible": np.random.default_rng(1).random((5000, 2))})
writers = {
    "yaml": lambda: write_configuration("winding_drum", machine_parameters("winding_drum"), path),
    "csv": lambda: write_table(asked, points, path),
    "parquet": lambda: write_table(asked, points, path),
    "designs": lambda: scan.write(path),
}
if len(sys.argv) > 3:
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), resource.RLIM_INFINITY))
try:
    writers[kind]()
except OutputError as error:
    sys.exit(str(error))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "name"),
    [("yaml", "found.yaml"), ("csv", "sweep.csv"), ("parquet", "sweep.parquet"), ("designs", "designs.parquet")],
)
def test_a_disk_that_fills_up_leaves_the_earlier_result_and_nothing_beside_it(
    tmp_path: Path, kind: str, name: str
) -> None:
    result = tmp_path / name

    def written(*limit: str) -> subprocess.CompletedProcess[str]:
        words = [sys.executable, "-c", PROGRAM, kind, str(result), *limit]
        return subprocess.run(words, capture_output=True, text=True, check=False, timeout=200)

    done = written()
    assert done.returncode == 0, done.stderr
    before = result.read_bytes()
    assert len(before) > 400
    failed = written("400")
    assert failed.returncode == 1, failed.stderr
    assert "cannot be written" in failed.stderr
    assert result.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == [name]
