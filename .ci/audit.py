# SPDX-License-Identifier: Apache-2.0
"""Checks what is installed against known vulnerabilities; fails if one is found, or if one could not be asked about.

Usage: audit.py VENV_BIN TOOLS_BIN
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

# wheels of ROS packages carry further distributions of these kinds, which no index knows
ROS_KINDS = ("ros-", "rosidl-", "rcl", "rcutils", "rmw-", "rosgraph-", "mech-twin")
ROS_ENDS = ("-msgs", "-interfaces", "-srvs")


def is_ros(name: str) -> bool:
    """Return whether a distribution is the twin itself or a part of ROS."""
    return name.startswith(ROS_KINDS) or name.endswith(ROS_ENDS)


def main(project: Path, tools: Path) -> int:
    """Return the exit code."""
    paths = "import site; print(site.getsitepackages()[0])"
    site = subprocess.run([project / "python", "-c", paths], capture_output=True, text=True, check=True).stdout.strip()
    command = [tools / "pip-audit", "--path", site, "--format", "json", "--progress-spinner", "off", "--skip-editable"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if not done.stdout.strip():
        sys.stderr.write(done.stderr)
        return 2
    found = [item for item in json.loads(done.stdout)["dependencies"] if not is_ros(item["name"].replace("_", "-"))]
    unasked = sorted(item["name"] for item in found if "skip_reason" in item)
    hit = [(item["name"], item["version"], bug["id"]) for item in found for bug in item.get("vulns", ())]
    for name, version, identifier in hit:
        sys.stdout.write(f"{name} {version}: {identifier}\n")
    if unasked:
        sys.stderr.write(f"not checked, the service does not answer for them: {', '.join(unasked)}\n")
    sys.stdout.write(f"{len(found) - len(unasked)} distributions checked, {len(hit)} vulnerabilities known\n")
    return 1 if hit else 2 if unasked else 0


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.argv[1]), Path(sys.argv[2])))
