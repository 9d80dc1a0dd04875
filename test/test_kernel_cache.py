# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels: never older than any source they are made of, shared by content, safe among processes."""

import json
import os
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

PACKAGE = {
    "__init__.py": "",
    "constants.py": "FACTOR = 2.0\n",
    "inner.py": """
from mech_twin.kernels.kernel import kernel
from .constants import FACTOR

@kernel
def scaled(value):
    return FACTOR * value

@kernel
def root(value):
    if value < 0.0:
        raise ValueError("no root of", value)
    return value ** 0.5
""",
    "outer.py": """
from numba import prange
from mech_twin.kernels.kernel import kernel, parallel_kernel
from kernel_trial import inner

@kernel
def raised(value):
    return inner.scaled(value) + 1.0

@kernel
def root_raised(value):
    return raised(inner.root(value))

@kernel
def root_lowered(value):
    return inner.root(value) - 1.0

@parallel_kernel
def doubled(values):
    for index in prange(len(values)):
        values[index] = inner.scaled(values[index])
    return values

def plain():
    from kernel_trial import unrelated
    return unrelated
""",
    "unrelated.py": "OTHER = 1\n",
    "pairs.py": """
from typing import NamedTuple

class Pair(NamedTuple):
    first: float
    second: float
""",
    "taker.py": """
from mech_twin.kernels.kernel import kernel

@kernel
def first(pair):
    return pair.first
""",
}
CALL = """
import json, sys
import numpy as np
from kernel_trial import outer, taker
from kernel_trial.pairs import Pair
from mech_twin.kernels.kernel import compiled_count
values = [outer.raised(1.5), float(outer.doubled(np.ones(4))[3]), taker.first(Pair(first=5.0, second=7.0))]
hits = [sum(f.stats.cache_hits.values()) for f in (outer.raised, outer.doubled, taker.first)]
print(json.dumps({"values": values, "hits": hits, "compiled": compiled_count()}))
"""
SIGNATURES = """
import sys, time
import numpy as np
from kernel_trial import outer
while time.time() < float(sys.argv[1]):
    pass
kinds = (np.float64, np.float32, np.int64, np.int32, np.int16, np.uint8)
kinds = kinds if sys.argv[2] == "up" else kinds[::-1]
for kind in kinds:
    assert outer.raised(kind(3)) == 7.0, kind
"""
CALLED_BOTH_WAYS = """
import json, sys
from kernel_trial import inner, outer
from mech_twin.kernels.kernel import compiled_count
results = []
for name in sys.argv[1:]:
    function = getattr(inner, name, None) or getattr(outer, name)
    results.append(function(4.0))
    try:
        results.append(function(-1.0))
    except ValueError as error:
        results.append(list(error.args))
hits = {name: sum(getattr(inner, name).stats.cache_hits.values()) for name in ("scaled", "root")}
print(json.dumps([results, hits, compiled_count()]))
"""
EDIT_WHILE_RUNNING = """
import sys
from pathlib import Path
from kernel_trial import outer
path = Path(outer.__file__).with_name("constants.py")
path.write_text("FACTOR = 50.0")
print(outer.raised(1.5))
"""
WHOLE = {"values": [4.0, 2.0, 5.0], "hits": [1, 1, 1], "compiled": 0}


@pytest.fixture
def package(tmp_path):
    return written_package(tmp_path / "one")


def written_package(folder):
    for name, text in PACKAGE.items():
        path = folder / "kernel_trial" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def environment(folder, cache, **others):
    kept = {name: os.environ[name] for name in ("PATH", "LD_LIBRARY_PATH") if name in os.environ}
    project = str(Path(__file__).parents[1])
    named = {"MECH_TWIN_CACHE_DIR": str(cache)} if cache else {}
    return {**kept, "PYTHONPATH": f"{folder}:{project}", "PYTHONDONTWRITEBYTECODE": "1", **named, **others}


def run(folder, cache, *prefix, **others):
    command = [*prefix, sys.executable, "-c", CALL]
    done = subprocess.run(
        command, check=False, env=environment(folder, cache, **others), capture_output=True, text=True, timeout=200
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


def change(folder, name, old, new):
    path = folder / "kernel_trial" / name
    status = path.stat()
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))  # a date tells nothing of the content


def stored(cache):
    return sorted(path for path in Path(cache).glob("*/*") if path.is_file())


def test_an_edit_in_any_file_a_kernel_reaches_changes_its_result(package, tmp_path):
    cache = tmp_path / "cache"
    assert run(package, cache)[0]["values"] == [4.0, 2.0, 5.0]
    assert run(package, cache)[0] == WHOLE
    change(package, "inner.py", "FACTOR * value", "FACTOR + value")
    assert run(package, cache)[0]["values"] == [4.5, 3.0, 5.0]
    change(package, "constants.py", "2.0", "9.0")  # two files away
    again, _ = run(package, cache)
    assert again["values"] == [11.5, 10.0, 5.0]
    assert again["hits"] == [0, 0, 1], "the kernel that reaches neither file is kept"


def test_code_of_a_run_during_which_a_file_was_edited_is_not_taken_for_that_of_the_edited_file(package, tmp_path):
    surroundings = environment(package, tmp_path / "cache")
    command = [sys.executable, "-c", EDIT_WHILE_RUNNING]
    during = subprocess.run(command, env=surroundings, check=True, capture_output=True, text=True, timeout=200)
    assert float(during.stdout) == 4.0
    assert run(package, tmp_path / "cache")[0]["values"][0] == 76.0


def test_a_kernel_that_kernels_call_is_called_from_python_too_and_its_errors_keep_their_numbers(package, tmp_path):
    def results(*names):
        command = [sys.executable, "-c", CALLED_BOTH_WAYS, *names]
        surroundings = environment(package, tmp_path / "cache")
        done = subprocess.run(command, check=True, env=surroundings, capture_output=True, text=True, timeout=200)
        return json.loads(done.stdout)

    error = ["no root of", -1.0]
    compiled = results("root_raised", "root")
    assert compiled == [[5.0, error, 2.0, error], {"scaled": 0, "root": 0}, 5]
    loaded = results("root_raised", "root")
    assert loaded == [[5.0, error, 2.0, error], {"scaled": 0, "root": 1}, 0]
    linked_to_another = results("root_lowered")
    assert linked_to_another == [[1.0, error], {"scaled": 0, "root": 1}, 1]
    of_intermediate_code = results("raised", "scaled")
    assert of_intermediate_code == [[9.0, -1.0, 8.0, -2.0], {"scaled": 1, "root": 0}, 2]


def test_an_edit_out_of_reach_compiles_nothing(package, tmp_path):
    run(package, tmp_path / "cache")
    change(package, "unrelated.py", "1", "2")
    assert run(package, tmp_path / "cache")[0] == WHOLE


def test_fields_of_an_argument_in_another_order_are_read_by_name(package, tmp_path):
    run(package, tmp_path / "cache")
    change(package, "pairs.py", "first: float\n    second: float", "second: float\n    first: float")
    assert run(package, tmp_path / "cache")[0]["values"][2] == 5.0


def test_the_same_sources_elsewhere_share_the_code(package, tmp_path):
    first, _ = run(package, tmp_path / "cache")
    assert first["compiled"] == 4
    other = written_package(tmp_path / "elsewhere" / "deeper")
    shutil.rmtree(package)
    assert run(other, tmp_path / "cache")[0] == WHOLE


def test_a_read_only_cache_is_read_and_new_code_goes_to_the_temporary_directory(package, tmp_path):
    cache, temporary = tmp_path / "cache", tmp_path / "temporary"
    temporary.mkdir()
    run(package, cache)
    before = stored(cache)
    for path in [cache, *cache.iterdir()]:
        path.chmod(0o555 if path.is_dir() else 0o444)
    # root may write anywhere unless it gives that right up
    bound = ["setpriv", "--bounding-set", "-all", "--inh-caps", "-all"] if os.geteuid() == 0 else []
    try:
        assert run(package, cache, *bound, TMPDIR=str(temporary))[0] == WHOLE
        change(package, "inner.py", "FACTOR * value", "FACTOR + value")
        assert run(package, cache, *bound, TMPDIR=str(temporary))[0]["hits"] == [0, 0, 1]
        assert run(package, cache, *bound, TMPDIR=str(temporary))[0]["hits"] == [1, 1, 1]
        assert stored(cache) == before
    finally:
        for path in [cache, *cache.iterdir()]:
            if path.is_dir():
                path.chmod(0o755)


def test_without_a_home_kernels_are_kept_in_a_private_temporary_directory(package, tmp_path):
    run(package, None, TMPDIR=str(tmp_path))
    own = tmp_path / f"mech_twin-kernels-{os.geteuid()}"
    assert stat.S_IMODE(own.stat().st_mode) == 0o700
    assert run(package, None, TMPDIR=str(tmp_path))[0] == WHOLE


@pytest.mark.parametrize("trap", ["link", "open to others"])
def test_a_temporary_directory_others_can_write_is_not_used(package, tmp_path, trap):
    own, target = tmp_path / f"mech_twin-kernels-{os.geteuid()}", tmp_path / "target"
    target.mkdir(mode=0o700)
    if trap == "link":
        own.symlink_to(target)
    else:
        own.mkdir()
        own.chmod(0o777)
    answer, told = run(package, None, TMPDIR=str(tmp_path))
    assert answer["values"] == [4.0, 2.0, 5.0]
    assert not stored(own)
    assert told.count("\n") == 1
    assert "MECH_TWIN_CACHE_DIR" in told


def test_the_convention_for_caches_is_kept(package, tmp_path):
    run(package, None, HOME=str(tmp_path / "home"))
    assert stored(tmp_path / "home" / ".cache" / "mech_twin" / "kernels")
    run(package, None, HOME=str(tmp_path / "home"), XDG_CACHE_HOME=str(tmp_path / "xdg"))
    assert stored(tmp_path / "xdg" / "mech_twin" / "kernels")


def test_two_first_runs_at_once_store_every_signature_whole(package, tmp_path):
    cache, start = tmp_path / "cache", str(time.time() + 3.0)
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", SIGNATURES, start, order], env=environment(package, cache), stderr=subprocess.PIPE
        )
        for order in ("up", "down")
    ]
    told = [process.communicate(timeout=200)[1] for process in runs]
    assert [process.returncode for process in runs] == [0, 0], told
    assert not list(cache.glob("*/.*")), "no unfinished file stays"
    kept = {path: path.stat().st_mtime_ns for path in stored(cache)}
    assert len(kept) == 12, "two kernels, six signatures"
    for order in ("up", "down"):
        script = SIGNATURES + "\nfrom mech_twin.kernels.kernel import compiled_count\nassert compiled_count() == 0\n"
        subprocess.run(
            [sys.executable, "-c", script, "0", order], env=environment(package, cache), check=True, timeout=200
        )
    assert kept == {path: path.stat().st_mtime_ns for path in stored(cache)}


@pytest.mark.parametrize("damage", ["empty", "noise", "cut", "flipped"])
def test_damaged_files_are_compiled_anew(package, tmp_path, damage):
    cache = tmp_path / "cache"
    run(package, cache)
    for path in stored(cache):
        whole = path.read_bytes()
        flipped = whole[:-9] + bytes([whole[-9] ^ 1]) + whole[-8:]
        path.write_bytes({"empty": b"", "noise": b"\x80\x05K" * 99, "cut": whole[:-1], "flipped": flipped}[damage])
    again, told = run(package, cache)
    assert (again["values"], again["hits"]) == ([4.0, 2.0, 5.0], [0, 0, 0])
    assert "damaged" in told
    assert run(package, cache)[0] == WHOLE


def test_only_code_unused_for_a_month_is_removed_and_once_a_day(package, tmp_path):
    cache = tmp_path / "cache"
    days = {"old": 31, "recent": 29}
    for name, age in days.items():
        (cache / name).mkdir(parents=True)
        (cache / name / "code").write_bytes(b"code")
        os.utime(cache / name, (time.time() - age * 86400,) * 2)
    run(package, cache)
    assert not (cache / "old").exists()
    assert (cache / "recent" / "code").exists()
    os.utime(cache / "recent", (0, 0))
    change(package, "inner.py", "FACTOR * value", "FACTOR + value")
    run(package, cache)
    assert (cache / "recent" / "code").exists()
    for directory in cache.glob("kernel_trial*"):
        os.utime(directory, (0, 0))
    run(package, cache)
    used = {
        path.name.split("-")[0] for path in cache.glob("kernel_trial*") if time.time() - path.stat().st_mtime < 3600
    }
    assert used == {"kernel_trial.outer", "kernel_trial.taker"}, (
        "what is loaded is dated, callees in line are not asked for"
    )


def test_each_compilation_is_counted_and_observed_and_leaves_the_collector_as_it_was(package, tmp_path):
    script = """
import gc
from mech_twin.kernels.kernel import compiled_count, on_compile
gc.set_threshold(701, 11, 12)
seen = []
end = on_compile(lambda kernel, count: seen.append((kernel, count)))
from kernel_trial import outer
outer.raised(1.0)
end()
outer.raised(1)
assert seen == [("kernel_trial.outer.raised", 1), ("kernel_trial.inner.scaled", 2)], seen
assert compiled_count() == 4
assert gc.get_threshold() == (701, 11, 12)
"""
    surroundings = environment(package, tmp_path / "cache")
    subprocess.run([sys.executable, "-c", script], env=surroundings, check=True, timeout=200)
