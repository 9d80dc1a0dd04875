# SPDX-License-Identifier: Apache-2.0
"""Writes the licences of the distributions that `make test` installs, as their metadata state them.

What else an environment holds is left out: constraints/hashes/jazzy.txt says what belongs to it.

Usage: licences.py VENV_BIN TOOLS_BIN FILE
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

# what states its licence elsewhere than in its metadata
STATED_ELSEWHERE = {
    "urdf_parser_py": "BSD (by its package.xml)",
    "FMPy": "BSD-2-Clause (by its LICENSE.txt)",
    "cuda-toolkit": "empty, names the packages of a toolkit",
}
HEAD = """# Licences

Here you find what an installation for development brings (`make test`), with the licence each distribution states;
written by `make licences`.
The twin itself is Apache-2.0 (`LICENSE`). Nothing of what is listed is copied into it.
Packages of the extra `cuda` named nvidia are proprietary, and free to use.

The wheels of ROS 2 state no licence in their metadata; the packages they are built from are
Apache-2.0 or BSD-3-Clause by their `package.xml`.
They are counted below and not listed one by one: {ros}.

| distribution | version | licence |
|---|---|---|
"""


def canonical(name: str) -> str:
    """Return a distribution's name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def listed() -> set[str]:
    """Return the distributions that `make test` installs."""
    pins = Path("constraints", "hashes", "jazzy.txt").read_text(encoding="utf-8")
    return set(re.findall(r"^([a-z0-9.-]+)==", pins, re.MULTILINE))


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


def licence(row: dict[str, str]) -> str:
    """Return the licence of a distribution, in one line."""
    return STATED_ELSEWHERE.get(row["Name"], row["License"]).replace("\n", " ")


def main(project: Path, tools: Path, file: Path) -> None:
    """Write the page."""
    found = rows(project, tools)
    ros = sum(is_ros(row) or is_ros_message(row) for row in found)
    named = listed()
    own = [row for row in found if canonical(row["Name"]) in named and not is_ros(row)]
    lines = [f"| {row['Name']} | {row['Version']} | {licence(row)} |" for row in own]
    file.write_text(HEAD.format(ros=ros) + "\n".join(lines) + "\n", encoding="utf-8")
    sys.stdout.write(f"wrote {file}\n")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]))
