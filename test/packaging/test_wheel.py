# SPDX-License-Identifier: Apache-2.0
"""What pip installs: the types' marker, the programs in both places, configuration; tried from a wheel made here."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
import tarfile
import venv
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest

from mech_twin import __version__

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = {f"{name}_node" for name in ("motor", "linkage", "force", "body", "frames", "recorder", "viewer")} | {
    "mech-twin"
}
pytestmark = pytest.mark.slow


def tracked() -> list[str]:
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("what is built is made of the files git knows of; this is no clone")
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    return [name for name in os.fsdecode(listed.stdout).split("\0") if name and (ROOT / name).is_file()]


def copied_source(place: Path) -> Path:
    """Copy the files git knows of to a place; return it."""
    for name in tracked():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, place / name)
    return place


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a wheel built from the files git knows of, away from the source tree."""
    place = tmp_path_factory.mktemp("wheel")
    copied_source(place / "source")
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--wheel-dir", str(place)]
    command = [sys.executable, "-m", "pip", "wheel", *options, str(place / "source")]
    subprocess.run(command, check=True, capture_output=True, cwd=place, env={**os.environ, "PYTHONPATH": ""})
    (found,) = place.glob("*.whl")
    return found


def test_wheel_holds_every_module_and_the_marker_of_its_types(wheel: Path) -> None:
    names = set(ZipFile(wheel).namelist())
    assert {name for name in tracked() if name.startswith("mech_twin/") and name.endswith(".py")} <= names
    assert "mech_twin/py.typed" in names
    assert not any(name.startswith(("test/", "benchmarks/", "docs/")) for name in names)


def test_wheel_is_of_the_version_the_package_says(wheel: Path) -> None:
    assert wheel.name == f"mech_twin-{__version__}-py3-none-any.whl"


def test_programs_are_where_ros2_run_looks_and_start(wheel: Path, tmp_path: Path) -> None:
    venv.create(tmp_path / "env", with_pip=False, symlinks=True)
    python = tmp_path / "env" / "bin" / "python"
    command = [sys.executable, "-m", "pip", "--python", str(python), "install", "--no-deps", "--no-index", "--quiet"]
    subprocess.run([*command, str(wheel)], check=True, capture_output=True, env={**os.environ, "PYTHONPATH": ""})
    found = {file.name: file for file in (tmp_path / "env" / "lib" / "mech_twin").iterdir()}
    assert set(found) == PROGRAMS
    for file in found.values():
        assert file.stat().st_mode & stat.S_IXUSR
        assert (tmp_path / "env" / "bin" / file.name).is_file()
    site = next(path for path in map(Path, sys.path) if path.name == "site-packages")
    # the libraries of this environment, the package of the new one
    environment = {**os.environ, "PYTHONPATH": str(site), "AMENT_PREFIX_PATH": str(tmp_path / "env")}
    environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    done = subprocess.run(
        [str(found["mech-twin"]), "simulate", "winding_drum", "--duration", "0.01", "--json"],
        capture_output=True, text=True, env=environment, cwd=tmp_path, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    share = tmp_path / "env" / "share" / "mech_twin"
    assert (share / "config" / "winding_drum.yaml").is_file()
    for name in (
        "launch/twin.launch.py",
        "launch/machines.launch.py",
        "rviz/mb10_breaker.rviz",
        "foxglove/mb10_breaker.json",
    ):
        assert (share / name).is_file()


def test_ros2_finds_an_editable_installation_and_its_programs(tmp_path: Path) -> None:
    """As `ros2 pkg` and `ros2 run` look: prefix and share by the index, programs in `lib` of the prefix."""
    source, env = copied_source(tmp_path / "source"), tmp_path / "env"
    venv.create(env, with_pip=False, symlinks=True)
    python = env / "bin" / "python"
    site = next(path for path in map(Path, sys.path) if path.name == "site-packages")
    (own,) = env.glob("lib/python*/site-packages")
    (own / "build_tools.pth").write_text(f"{site}\n", encoding="utf-8")  # setuptools, which pip does not fetch here
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--quiet"]
    command = [sys.executable, "-m", "pip", "--python", str(python), "install", *options, "-e", str(source)]
    subprocess.run(command, check=True, capture_output=True, env={**os.environ, "PYTHONPATH": ""})
    asked = (
        "from ament_index_python.packages import get_package_prefix as prefix, get_package_share_directory as share\n"
        "import mech_twin\n"
        "print(prefix('mech_twin'), share('mech_twin'), mech_twin.__file__, sep='\\n')"
    )
    environment = {**os.environ, "PYTHONPATH": "", "AMENT_PREFIX_PATH": str(env)}
    environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    there: dict[str, Any] = {"capture_output": True, "text": True, "env": environment, "cwd": tmp_path}
    told = subprocess.run([str(python), "-c", asked], check=False, **there)
    assert told.returncode == 0, told.stderr
    assert told.stdout.split() == [str(env), str(env / "share" / "mech_twin"), str(source / "mech_twin/__init__.py")]
    assert (env / "share" / "mech_twin" / "package.xml").is_file()
    assert not (env / "share" / "mech_twin" / "config").exists(), "a copy would go stale beside the one that is edited"
    found = {file.name: file for file in (env / "lib" / "mech_twin").iterdir()}
    assert set(found) == PROGRAMS
    done = subprocess.run([str(found["mech-twin"]), "--version"], check=False, timeout=120, **there)
    assert done.returncode == 0 and __version__ in done.stdout, done.stderr


def test_source_distribution_holds_every_file(tmp_path: Path) -> None:
    copied_source(tmp_path)
    command = [sys.executable, "setup.py", "--quiet", "sdist"]
    subprocess.run(command, check=True, capture_output=True, cwd=tmp_path, env={**os.environ, "PYTHONPATH": ""})
    (made,) = (tmp_path / "dist").glob("*.tar.gz")
    with tarfile.open(made) as archive:
        held = {name.partition("/")[2] for name in archive.getnames()}
    assert [name for name in tracked() if name not in held and "node_modules" not in name] == []
