# SPDX-License-Identifier: Apache-2.0
"""Writes the licences of all distributions of an environment, as their metadata state them.

Usage: licences.py VENV_BIN TOOLS_BIN FILE
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

HEAD = """# Licences

What an installation for development brings (`make test`), with the licence each distribution states;
written by `make licences`.
The twin itself is Apache-2.0 (`LICENSE`). Nothing of what is listed is copied into it.

The wheels of ROS 2 state no licence in their metadata; the packages they are built from are
Apache-2.0 or BSD-3-Clause by their `package.xml`.
They are counted below and not listed one by one: {ros}.

| distribution | version | licence |
|---|---|---|
"""


def rows(project: Path, tools: Path) -> list[dict[str, str]]:
    """Return name, version and licence of every distribution but the twin's own."""
    command = [tools / "pip-licenses", f"--python={project / 'python'}", "--format=json", "--order=name"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return [row for row in json.loads(done.stdout) if row["Name"] != "mech_twin"]


def is_ros(row: dict[str, str]) -> bool:
    """Return whether a distribution states nothing and is one of ROS 2's."""
    return row["License"] == "UNKNOWN" and row["Name"].startswith(("ros-", "rosidl_", "rcl", "rcutils", "rmw_"))


def is_ros_message(row: dict[str, str]) -> bool:
    """Return whether a distribution is a message package that came in a wheel of ROS 2."""
    return row["License"] == "UNKNOWN" and row["Name"].endswith(("_msgs", "_interfaces", "_srvs"))


def main(project: Path, tools: Path, file: Path) -> None:
    """Write the page."""
    found = rows(project, tools)
    own = [row for row in found if not is_ros(row) and not is_ros_message(row)]
    lines = [f"| {row['Name']} | {row['Version']} | {row['License'].replace(chr(10), ' ')} |" for row in own]
    file.write_text(HEAD.format(ros=len(found) - len(own)) + "\n".join(lines) + "\n", encoding="utf-8")
    sys.stdout.write(f"wrote {file}\n")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]))
