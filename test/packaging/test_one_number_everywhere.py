# SPDX-License-Identifier: Apache-2.0
"""What is written in more than one file agrees: the version, the oldest Python, the pins and their hashes."""

from __future__ import annotations

import json
import re
import subprocess
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from mech_twin import __version__

ROOT = Path(__file__).resolve().parents[2]
MINIMUM = "3.11"
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def text(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def only(pattern: str, name: str) -> str:
    found = re.findall(pattern, text(name), re.MULTILINE)
    assert len(found) == 1, (name, pattern, found)
    return str(found[0])


def test_version_is_the_same_wherever_it_stands() -> None:
    citation = yaml.safe_load(text("CITATION.cff"))
    assert ElementTree.parse(ROOT / "package.xml").getroot().findtext("version") == __version__
    assert citation["version"] == __version__
    assert re.search(rf"^## \[({re.escape(__version__)}|Unreleased)\]", text("CHANGELOG.md"), re.MULTILINE)
    assert 'version="' not in text("setup.py"), "setup.py reads the version, it does not repeat it"


def test_changelog_has_each_version_once_newest_first_with_its_day() -> None:
    heads = re.findall(r"^## \[(.+?)\](?: - (.+))?$", text("CHANGELOG.md"), re.MULTILINE)
    assert heads[0] == ("Unreleased", "")
    numbers = [tuple(map(int, name.split("."))) for name, _ in heads[1:]]
    assert numbers == sorted(set(numbers), reverse=True)
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\d", day) for _, day in heads[1:])
    kinds = set(re.findall(r"^### (.+)$", text("CHANGELOG.md"), re.MULTILINE))
    assert kinds <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}


def test_oldest_python_is_the_same_wherever_it_stands() -> None:
    assert only(r'python_requires=">=([\d.]+)"', "setup.py") == MINIMUM
    assert only(r"^PYTHON_MINIMUM := ([\d.]+)$", "Makefile") == MINIMUM
    assert only(r"^Python ([\d.]+) or newer", "README.md") == MINIMUM
    assert PYPROJECT["tool"]["mypy"]["python_version"] == MINIMUM
    assert PYPROJECT["tool"]["ruff"]["target-version"] == f"py{MINIMUM.replace('.', '')}"


def test_actions_try_the_oldest_python_and_the_two_after_it() -> None:
    jobs = yaml.safe_load(text(".github/workflows/ci.yml"))["jobs"]
    major, minor = map(int, MINIMUM.split("."))
    assert jobs["fast"]["strategy"]["matrix"]["python"] == [f"{major}.{minor + more}" for more in range(3)]


def test_an_older_python_is_refused_in_one_line(tmp_path: Path) -> None:
    old = tmp_path / "python"
    old.write_text("#!/bin/sh\nexec python3 -c 'import sys; sys.version_info = (3, 9, 2)\n'\"$2\"\n", encoding="utf-8")
    old.chmod(0o755)
    target = tmp_path / "env" / "bin" / "python"
    command = ["make", "--silent", f"VENV={tmp_path / 'env'}", f"PYTHON={old}", str(target)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode != 0
    assert not target.exists()
    assert f"Python {MINIMUM} or newer is needed; found 3.9" in done.stderr.splitlines()[0]


def pins(*names: str) -> dict[str, str]:
    lines = [line for name in names for line in text(f"constraints/{name}.txt").splitlines()]
    pairs = (line.split("==") for line in lines if "==" in line and not line.startswith("#"))
    return {re.sub(r"[-_.]+", "-", name).lower(): version for name, version in pairs}


@pytest.mark.parametrize("line", ["jazzy", "kilted"])
def test_hashed_pins_are_the_pins_and_carry_no_address(line: str) -> None:
    listed = text(f"constraints/hashes/{line}.txt")
    assert "://" not in listed
    assert all(re.match(r"(--hash=sha256:[0-9a-f]{64}|[a-z0-9.-]+==)", row.strip()) for row in listed.splitlines())
    hashed = dict(re.findall(r"^([a-z0-9.-]+)==(\S+)", listed, re.MULTILINE))
    known = pins("python", line)
    assert {name: known.get(name) for name in hashed} == hashed
    assert {"numpy", "rerun-sdk", "ros-rclpy", "pytest"} <= set(hashed)
    for name in hashed:
        assert re.search(rf"^{re.escape(name)}==\S+ \\\n    --hash=sha256:", listed, re.MULTILINE), f"{name}: no hash"


def test_javascript_lock_names_exact_versions_hashes_and_no_address() -> None:
    packages = json.loads(text("test/recording/npm/package-lock.json"))["packages"]
    for name, package in packages.items():
        assert "resolved" not in package
        assert not name or package["integrity"].startswith("sha512-")
