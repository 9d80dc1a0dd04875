# SPDX-License-Identifier: Apache-2.0
"""Writes the pins with the hashes of their files, one list for each ROS 2 line; asks the package index.

Usage: hashes.py TOOLS_BIN
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

EXTRAS = ("view", "plots", "tables", "cluster", "alerts", "foxglove", "fmu", "life", "cuda", "test")


def main(tools: Path) -> None:
    """Rewrite constraints/hashes."""
    for line in ("jazzy", "kilted"):
        extras = [word for name in (line, *EXTRAS) for word in ("--extra", name)]
        pins = ["-c", "constraints/python.txt", "-c", f"constraints/{line}.txt"]
        shape = ["--generate-hashes", "--no-header", "--no-annotate", "--python-version", "3.11", "--quiet"]
        platform = ["--python-platform", "x86_64-unknown-linux-gnu"]
        out = Path("constraints", "hashes", f"{line}.txt")
        fresh = out.with_suffix(".new")  # an index that cannot be reached costs no list
        fresh.unlink(missing_ok=True)
        command = [tools / "uv", "pip", "compile", "setup.py", *extras, *pins, *shape, *platform, "-o", fresh]
        try:
            subprocess.run(command, check=True)
            fresh.replace(out)
        finally:
            fresh.unlink(missing_ok=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
