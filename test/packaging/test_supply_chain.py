# SPDX-License-Identifier: Apache-2.0
"""The scripts on software components: what they write is whole and of today, what they find ends in an exit code."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from ci_scripts import ci_script

ROOT = Path(__file__).resolve().parents[2]
AUDIT, BILL, LICENCES = ci_script("audit"), ci_script("sbom"), ci_script("licences")
BUILD_TOOLS = {"setuptools"}  # pip-licenses counts it as part of the environment


def program(file: Path, text: str) -> None:
    """Write a program of the shell, in the place of a tool that asks the network."""
    file.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    file.chmod(0o755)


def environment(folder: Path) -> Path:
    program(folder / "python", "echo /nowhere")
    return folder


def audited(folder: Path, dependencies: list[dict[str, Any]]) -> int:
    answer = folder / "answer.json"
    answer.write_text(json.dumps({"dependencies": dependencies}), encoding="utf-8")
    program(folder / "pip-audit", f"cat '{answer}'")
    code: int = AUDIT.main(environment(folder), folder)
    return code


SOUND = {"name": "numpy", "version": "2.3.0", "vulns": []}
HIT = {"name": "requests", "version": "2.5.0", "vulns": [{"id": "PYSEC-2018-28", "fix_versions": ["2.20.0"]}]}
UNKNOWN = {"name": "somebodys-own", "skip_reason": "Dependency not found on PyPI"}
ROS_WHEEL = {"name": "sensor_msgs", "skip_reason": "Dependency not found on PyPI"}


@pytest.mark.parametrize(
    ("found", "code"),
    [([SOUND], 0), ([SOUND, ROS_WHEEL], 0), ([SOUND, UNKNOWN], 2), ([SOUND, HIT], 1), ([HIT, UNKNOWN], 1)],
)
def test_a_known_vulnerability_and_what_could_not_be_asked_about_end_the_check(
    found: list[dict[str, Any]], code: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert audited(tmp_path, found) == code
    said = capsys.readouterr()
    assert ("requests 2.5.0: PYSEC-2018-28" in said.out) == (HIT in found)
    assert ("somebodys-own" in said.err) == (UNKNOWN in found)


def test_a_service_that_does_not_answer_is_no_clean_bill(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program(tmp_path / "pip-audit", "echo 'no route to host' >&2; exit 1")
    assert AUDIT.main(environment(tmp_path), tmp_path) == 2
    assert "no route to host" in capsys.readouterr().err


def bill_of(folder: Path, component: dict[str, Any]) -> Path:
    """Return the bill made of what the tool says of one component."""
    said, file = folder / "said.json", folder / "sbom.json"
    said.write_text(json.dumps({"components": [component]}), encoding="utf-8")
    program(folder / "cyclonedx-py", f'while [ "$1" != -o ]; do shift; done; cp \'{said}\' "$2"')
    BILL.main(environment(folder), folder, file)
    return file


def test_the_bill_of_materials_keeps_components_and_drops_places_of_this_machine(tmp_path: Path) -> None:
    links = [{"url": "file:///home/somebody/twin"}, {"url": "https://example.org/twin"}]
    file = bill_of(tmp_path, {"name": "mech_twin", "version": "1.0", "externalReferences": links})
    [component] = json.loads(file.read_text(encoding="utf-8"))["components"]
    assert (component["name"], component["externalReferences"]) == ("mech_twin", links[1:])


def test_a_bill_of_materials_that_would_name_a_place_of_this_machine_is_refused(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="would name a place"):
        bill_of(tmp_path, {"name": "mech_twin", "properties": [{"value": str(Path.cwd())}]})


def test_every_installed_distribution_stands_among_the_licences_with_its_version() -> None:
    pinned = (ROOT / "constraints/hashes/jazzy.txt").read_text(encoding="utf-8")
    pins = dict(re.findall(r"^([a-z0-9.-]+)==(\S+)", pinned, re.MULTILINE))
    page = (ROOT / "docs/licences.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\S+) \| (\S+) \| (.+) \|$", page, re.MULTILINE)
    stated = {LICENCES.canonical(name): (version, licence) for name, version, licence in rows if version[0].isdigit()}
    silent = {name for name in pins if name.startswith("ros-")}  # most wheels of ROS state none: counted on the page
    assert set(pins) - silent - BUILD_TOOLS <= set(stated) <= set(pins)
    assert {name: version for name, (version, _) in stated.items()} == {name: pins[name] for name in stated}
    assert [name for name, (_, licence) in stated.items() if licence == "UNKNOWN"] == []


def test_vulnerabilities_and_the_bill_are_a_job_that_also_runs_without_a_commit() -> None:
    flow = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))
    steps = [step.get("run") for step in flow["jobs"]["supply-chain"]["steps"]]
    assert {"make audit", "make sbom"} <= set(steps)
    assert "if" not in flow["jobs"]["supply-chain"]
    assert flow[True]["schedule"]  # YAML 1.1 reads the key `on` as true
