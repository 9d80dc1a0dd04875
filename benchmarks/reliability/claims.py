# SPDX-License-Identifier: Apache-2.0
"""Run every test that docs/proof/reliability.md names, and write the counts into that page.

    python benchmarks/reliability/claims.py [TEST_FILE ...]

One process a file.  Exit code 1 if a test failed.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

from measured import PAGE, add_rows, here

ROOT = PAGE.parents[2]
COLUMNS = ("file", "passed", "skipped or failed", "took", "made")


def named_tests(page: str) -> list[str]:
    """Return the files of tests that a page names, in order."""
    return list(dict.fromkeys(re.findall(r"test/[\w/]+\.py", page)))


def counted(file: str) -> tuple[list[object], int]:
    """Run the tests of a file and return its row, and how many failed."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-m", "not browser", f"--junitxml={report}", file]
        subprocess.run(command, cwd=ROOT, check=False)
        suite = next(ElementTree.parse(report).getroot().iter("testsuite"))
    tests, skipped = int(suite.get("tests", 0)), int(suite.get("skipped", 0))
    failed = int(suite.get("failures", 0)) + int(suite.get("errors", 0))
    took = f"{float(suite.get('time', 0.0)):.0f} s"
    others = ", ".join(f"{count} {word}" for count, word in ((skipped, "skipped"), (failed, "failed")) if count)
    return [f"`{file}`", tests - skipped - failed, others, took, here()], failed


def main() -> int:
    """Run the tests, and write what was counted after each file."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    failed = 0
    for file in sys.argv[1:] or named_tests(PAGE.read_text(encoding="utf-8")):
        row, broken = counted(file)
        failed += broken
        add_rows("claims", COLUMNS, [row])
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
