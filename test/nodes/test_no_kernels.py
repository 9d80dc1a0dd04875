# SPDX-License-Identifier: Apache-2.0
"""A process that records, shows or observes compiles no kernel but those that check a configuration."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

# positions and masses of a linkage, of which limits of a configuration are made: no kernel of a motion
POSITIONS = {"coefficients", "link_angles", "loaded_height", "masses_at", "position", "weight_moments"}
POSITIONS |= {"loaded_heights", "turn_rocker_rates"}  # the same over a turn of the crank
SCRIPT = """
import sys
import rclpy
from numba.core.dispatcher import Dispatcher
from pathlib import Path

def compiled():
    loaded = [module for name, module in sys.modules.items() if name.startswith("mech_twin")]
    return sorted({
        f"{value.py_func.__module__}.{value.py_func.__name__}"
        for module in loaded for value in vars(module).values() if isinstance(value, Dispatcher) and value.overloads
    })

rclpy.init(args=[])
kind, machine, place = sys.argv[1:]
if kind == "recorder":
    from mech_twin.nodes.roles.recorder_node import RecorderNode
    node = RecorderNode(machine, Path(place))
elif kind == "viewer":
    from mech_twin.nodes.roles.viewer_node import ViewerNode
    node = ViewerNode(machine, place + ".rrd")
elif kind == "observer":
    from mech_twin.nodes.roles.viewer_node import ObserverNode
    node = ObserverNode(machine)
elif kind == "configuration":
    from mech_twin.parameters.load import machine_parameters
    machine_parameters(machine)
    node = rclpy.create_node("none")
    node.close = lambda: None
else:
    from mech_twin.nodes.roles.answering_nodes import ForceNode
    node = ForceNode(machine)
print("compiled", len(compiled()), compiled())
node.close()
node.destroy_node()
rclpy.shutdown()
"""


def compiled_kernels(kind: str, machine: str, place: Path) -> list[str]:
    run = subprocess.run(
        [sys.executable, "-c", SCRIPT, kind, machine, str(place)],
        env=os.environ.copy(),
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    said = next(line for line in run.stdout.splitlines() if line.startswith("compiled"))
    return list(ast.literal_eval(said.split(maxsplit=2)[2]))


@pytest.mark.slow
@pytest.mark.usefixtures("ros_domain")
@pytest.mark.parametrize("machine", ["mb10_breaker", "compaction_press", "vibration_crank"])
@pytest.mark.parametrize("kind", ["recorder", "viewer", "observer"])
def test_a_node_without_a_role_compiles_no_kernel(kind: str, machine: str, tmp_path: Path) -> None:
    """These are machines whose very construction compiles; see the control below."""
    checking = compiled_kernels("configuration", machine, tmp_path / "none")
    assert not [name for name in checking if name.rpartition(".")[2] not in POSITIONS], "the check of a configuration"
    assert compiled_kernels(kind, machine, tmp_path / "out") == checking


@pytest.mark.slow
@pytest.mark.usefixtures("ros_domain")
def test_a_role_node_does_compile(tmp_path: Path) -> None:
    assert len(compiled_kernels("force_analysis", "mb10_breaker", tmp_path)) > 1
