# SPDX-License-Identifier: Apache-2.0
"""Writes the bill of materials (CycloneDX, JSON) of an environment, without a path of this machine in it.

Usage: sbom.py VENV_BIN TOOLS_BIN FILE
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path


def main(project: Path, tools: Path, file: Path) -> None:
    """Write the file, or end with a line that says what it must not hold."""
    file.unlink(missing_ok=True)
    command = [tools / "cyclonedx-py", "environment", "--output-reproducible", "--of", "JSON", "-o", file]
    subprocess.run([*command, project / "python"], check=True)
    bill = json.loads(file.read_text(encoding="utf-8"))
    for part in bill["components"]:  # the twin's own, installed from this directory
        part["externalReferences"] = [
            link for link in part.get("externalReferences", ()) if not link["url"].startswith("file:")
        ]
    text = json.dumps(bill, indent=1, sort_keys=True)
    for leak in ("file://", str(Path.cwd()), str(Path.home()) + "/"):
        if leak in text:
            raise SystemExit(f"{file}: would name a place of this machine ({leak})")
    file.write_text(text + "\n", encoding="utf-8")
    sys.stdout.write(f"wrote {file}\n")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:4]))
