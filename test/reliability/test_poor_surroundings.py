# SPDX-License-Identifier: Apache-2.0
"""Where the system lacks something the command works, or says in one line what is missing."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from mech_twin.cli.console import EXIT_CODE
from mech_twin.kernels.cache import directories
from mech_twin.process.dependencies import lacking

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("ros_domain")]
ROOT = Path(__file__).resolve().parents[2]
STORY = ROOT / "bags" / "weak_spring"
COMMAND = [sys.executable, "-c", "from mech_twin.cli.main import main; main()"]
MAY_MOUNT = (
    shutil.which("unshare") is not None
    and os.geteuid() == 0
    and not subprocess.run(["unshare", "-m", "mount", "-t", "tmpfs", "t", "/dev/shm"], check=False).returncode
)
READS_ALL = ["--inh-caps", "+dac_read_search", "--ambient-caps", "+dac_read_search"]  # an interpreter of root too
SOMEBODY = ["setpriv", "--reuid", "65534", "--regid", "65534", "--clear-groups", *READS_ALL]
VERSION = [sys.executable, "-c", "import sys; print(sys.version)"]
MAY_BE_SOMEBODY = (
    shutil.which("setpriv") is not None
    and os.geteuid() == 0
    and subprocess.run([*SOMEBODY, *VERSION], capture_output=True, text=True, check=False).stdout == f"{sys.version}\n"
)
needs_mounts = pytest.mark.skipif(not MAY_MOUNT, reason="needs a mount namespace of its own (root)")


def called(
    words: Sequence[str],
    environment: Mapping[str, str | None] | None = None,
    limits: Callable[[], None] | None = None,
    wrapped: Sequence[str] = (),
) -> subprocess.CompletedProcess[str]:
    changed = environment or {}
    kept = {key: value for key, value in os.environ.items() if key not in changed}
    given = {key: value for key, value in changed.items() if value is not None}
    return subprocess.run(
        [*wrapped, *COMMAND, *words],
        capture_output=True,
        text=True,
        env=kept | given,
        preexec_fn=limits,
        timeout=240,
        check=False,
    )


def simulate() -> list[str]:
    return ["simulate", "impact_mass", "--duration", "0.05", "--json"]


def run(bag: Path) -> list[str]:
    words = ["--duration", "0.2", "--pace", "max", "--view", "none", "--record", str(bag), "--json"]
    return ["run", "winding_drum", *words]


def limited(kind: int, value: int) -> Callable[[], None]:
    return lambda: resource.setrlimit(kind, (value, value))


def in_a_small_mount(place: str, size_kib: int, filled_kib: int) -> list[str]:
    script = (
        f"mount -t tmpfs -o size={size_kib}k t {place}; "
        f"dd if=/dev/zero of={place}/filling bs=1k count={filled_kib} 2>/dev/null; "
        'exec "$@"'
    )
    return ["unshare", "-m", "sh", "-c", script, "sh"]


def assert_works(done: subprocess.CompletedProcess[str]) -> Any:
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def assert_said_in_one_line(done: subprocess.CompletedProcess[str], words: str) -> None:
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr
    assert [line for line in done.stderr.splitlines() if words in line], done.stderr


@pytest.mark.parametrize("home", [None, "/nonexistent"])
def test_without_a_home(home: str | None, tmp_path: Path) -> None:
    changed = {"HOME": home, "MECH_TWIN_CACHE_DIR": str(directories()[0])}  # spares compiling: test_kernel_cache.py
    assert_works(called(run(tmp_path / "bag"), changed))


def test_without_a_directory_for_temporary_files(tmp_path: Path) -> None:
    assert_works(called(run(tmp_path / "bag"), {"TMPDIR": "/proc/nowhere"}))


def test_with_a_directory_for_logs_that_cannot_be_made(tmp_path: Path) -> None:
    done = called(run(tmp_path / "bag"), {"ROS_LOG_DIR": "/proc/nowhere"})
    assert_said_in_one_line(done, "ROS_LOG_DIR /proc/nowhere: cannot be made")


@needs_mounts
def test_with_a_full_directory_for_temporary_files(tmp_path: Path) -> None:
    full = tmp_path / "full"
    full.mkdir()
    assert_works(called(run(tmp_path / "bag"), {"TMPDIR": str(full)}, wrapped=in_a_small_mount(str(full), 64, 64)))


def test_with_64_open_files(tmp_path: Path) -> None:
    limits = limited(resource.RLIMIT_NOFILE, 64)
    assert_works(called(simulate(), limits=limits))
    assert_works(called(run(tmp_path / "bag"), limits=limits))


def test_with_too_few_open_files(tmp_path: Path) -> None:
    done = called(run(tmp_path / "bag"), limits=limited(resource.RLIMIT_NOFILE, 12))
    assert_said_in_one_line(done, "too many open files (limit 12)")


@pytest.mark.parametrize("kib", [200_000, 300_000, 400_000])
def test_with_less_address_space_than_the_kernels_take(kib: int) -> None:
    limits = limited(resource.RLIMIT_AS, kib << 10)
    assert_said_in_one_line(called(simulate(), limits=limits), "the numerical libraries take 480 MiB")


def test_with_512_mib_of_address_space(tmp_path: Path) -> None:
    limits = limited(resource.RLIMIT_AS, 512 << 20)
    assert_works(called(simulate(), limits=limits))
    assert_said_in_one_line(called(run(tmp_path / "bag"), limits=limits), "not enough memory")


@needs_mounts
def test_with_little_shared_memory(tmp_path: Path) -> None:
    assert_works(called(run(tmp_path / "bag"), wrapped=in_a_small_mount("/dev/shm", 5 * 1024, 0)))


@needs_mounts
@pytest.mark.parametrize(("size_kib", "filled_kib"), [(64, 64), (5 * 1024, 2 * 1024)])
def test_with_shared_memory_that_is_full(size_kib: int, filled_kib: int, tmp_path: Path) -> None:
    done = called(run(tmp_path / "bag"), wrapped=in_a_small_mount("/dev/shm", size_kib, filled_kib))
    assert_said_in_one_line(done, "/dev/shm is full")
    assert not (tmp_path / "bag").exists()


@needs_mounts
def test_with_shared_memory_that_cannot_be_written(tmp_path: Path) -> None:
    """The middleware says so on standard output, whatever was asked to be written there."""
    wrapped = ["unshare", "-m", "sh", "-c", 'mount -t tmpfs -o ro t /dev/shm; exec "$@"', "sh"]
    done = called(run(tmp_path / "bag"), wrapped=wrapped)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout[done.stdout.index("{\n") :])["machine"] == "winding_drum"


@pytest.mark.parametrize("verb", ["run", "shadow"])
def test_with_dds_security_asked_for_and_no_keys(verb: str, tmp_path: Path) -> None:
    """Nothing runs unsecured in its place; the wheels have no security even where there are keys."""
    asked = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce", "ROS_SECURITY_KEYSTORE": str(tmp_path)}
    words = run(tmp_path / "bag") if verb == "run" else newer_verbs(tmp_path)["shadow"]
    assert_said_in_one_line(called(words, asked), "DDS security cannot be had")
    assert not (tmp_path / "bag").exists()


def newer_verbs(folder: Path) -> dict[str, list[str]]:
    """Return a short call of each verb that judges, maps or follows a machine, with its answer as JSON."""
    story = [
        "--map",
        f"{STORY}/map.yaml",
        "--baseline",
        f"{STORY}/healthy.json",
        "--config",
        f"{STORY}/mb10_breaker.yaml",
    ]
    sensors = str(ROOT / "benchmarks" / "monitoring" / "sensors" / "winding_drum.yaml")
    return {
        "map": ["map", str(ROOT / "bags" / "impact_mass"), "impact_mass", "--json"],
        "monitor": ["monitor", "mb10_breaker", f"{STORY}/watched", "--skip", "0", *story, "--json"],
        "identify": ["identify", "winding_drum", "--plan", "--sensors", sensors, "--duration", "2", "--json"],
        "shadow": [
            "shadow",
            "winding_drum",
            "--from",
            "elsewhere",
            "--duration",
            "0.3",
            "--record",
            f"{folder}/bag",
            "--json",
        ],
    }


NEWER = ("map", "monitor", "identify", "shadow")
OFFLINE = NEWER[:-1]
FAULT_FOUND = 1


def assert_answers(verb: str, done: subprocess.CompletedProcess[str]) -> None:
    assert done.returncode == (FAULT_FOUND if verb == "monitor" else 0), done.stderr
    assert json.loads(done.stdout)
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("verb", NEWER)
def test_a_newer_verb_without_home_or_temporary_directory_and_with_64_open_files(verb: str, tmp_path: Path) -> None:
    changed = {"HOME": None, "TMPDIR": "/proc/nowhere", "MECH_TWIN_CACHE_DIR": str(directories()[0])}
    done = called(newer_verbs(tmp_path)[verb], changed, limited(resource.RLIMIT_NOFILE, 64))
    assert_answers(verb, done)


@pytest.mark.parametrize("verb", NEWER)
def test_a_newer_verb_with_512_mib_of_address_space_answers_or_says_what_is_missing(verb: str, tmp_path: Path) -> None:
    done = called(newer_verbs(tmp_path)[verb], limits=limited(resource.RLIMIT_AS, 512 << 20))
    if done.returncode == EXIT_CODE:
        assert_said_in_one_line(done, "not enough memory")
    else:
        assert_answers(verb, done)


@needs_mounts
@pytest.mark.parametrize("verb", OFFLINE)
def test_a_newer_verb_without_topics_answers_or_says_that_shared_memory_is_full(verb: str, tmp_path: Path) -> None:
    done = called(newer_verbs(tmp_path)[verb], wrapped=in_a_small_mount("/dev/shm", 64, 64))
    if done.returncode == EXIT_CODE:
        assert_said_in_one_line(done, "/dev/shm is full")
    else:
        assert_answers(verb, done)


@needs_mounts
def test_a_shadow_with_shared_memory_that_is_full(tmp_path: Path) -> None:
    done = called(newer_verbs(tmp_path)["shadow"], wrapped=in_a_small_mount("/dev/shm", 64, 64))
    assert_said_in_one_line(done, "/dev/shm is full")


@needs_mounts
@pytest.mark.parametrize("verb", NEWER)
def test_a_newer_verb_with_a_full_temporary_directory_and_kernels_that_cannot_be_kept(
    verb: str, tmp_path: Path
) -> None:
    full, kernels = tmp_path / "full", directories()[0]
    full.mkdir()
    script = (
        f"mount -t tmpfs -o size=64k t {full}; dd if=/dev/zero of={full}/filling bs=1k count=64 2>/dev/null; "
        f'mount --bind {kernels} {kernels}; mount -o remount,ro,bind {kernels}; exec "$@"'
    )
    done = called(
        newer_verbs(tmp_path)[verb], {"TMPDIR": str(full)}, wrapped=["unshare", "-m", "sh", "-c", script, "sh"]
    )
    assert_answers(verb, done)


@pytest.mark.skipif(not MAY_BE_SOMEBODY, reason="needs an interpreter that another user may run (root)")
@pytest.mark.parametrize("verb", NEWER)
def test_a_newer_verb_of_another_user_with_no_home_of_its_own(verb: str) -> None:
    """Kernels are read from a directory that it may not write in, and it may not log where it would."""
    with tempfile.TemporaryDirectory() as name:  # that of pytest is its user's alone
        folder = Path(name)
        folder.chmod(0o777)
        assert_answers(verb, called(newer_verbs(folder / "first")[verb]))  # what is compiled is in the directory then
        home, temporary = folder / "home", folder / "temporary"
        (home / ".ros" / "log").mkdir(parents=True)
        temporary.mkdir()
        temporary.chmod(0o777)
        changed = {"HOME": str(home), "MECH_TWIN_CACHE_DIR": str(directories()[0]), "TMPDIR": str(temporary)}
        assert_answers(verb, called(newer_verbs(folder)[verb], changed, wrapped=SOMEBODY))
        assert not [*temporary.glob("mech_twin-kernels-*/*")]  # none was compiled


@pytest.mark.parametrize(("limit", "lacks"), [(512 << 20, True), (resource.RLIM_INFINITY, False)])
def test_an_extension_that_found_no_memory_lacks_it_where_there_is_a_limit(
    limit: int, lacks: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (limit, limit))
    told = lacking(SystemError("error return without exception set"))
    assert (told is not None and "not enough memory (limit of address space 512 MiB)" in told) is lacks


def test_an_error_of_the_programs_own_is_not_taken_for_a_lack() -> None:
    assert lacking(ValueError("failed")) is None
    assert lacking(RuntimeError("failed")) is None
    assert lacking(ImportError("No module named 'x'")) is None
    assert lacking(FileNotFoundError(2, "No such file")) is None
