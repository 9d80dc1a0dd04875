# SPDX-License-Identifier: Apache-2.0
"""Breaks the physics in small ways, one at a time, and lists what no test noticed (cosmic-ray, in a copy of the tree).

Usage: mutate.py VENV_BIN TOOLS_BIN [TARGET...]; targets stand in .ci/mutation.toml, all without one.
A target with a `sample` breaks that many places of those there are, always the same ones.
Writes build/mutation/TARGET.txt with the survivors and a line for each target; exit code 1 if a target's own tests fail
before anything is broken.
"""

from __future__ import annotations

import os
import random
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path
from typing import Any

from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import TestOutcome, WorkerOutcome, WorkResult

OUT = Path("build", "mutation")
SHORTEST_TIMEOUT_S, TIMEOUT_OVER_BASELINE = 60.0, 5.0  # longer is an endless loop, and counts as noticed
FILTERED = [
    "core/ReplaceBinaryOperator_BitOr_.*",  # `float | None` in a signature: breaking it breaks nothing
    "core/Replace.*_(BitOr|BitAnd|BitXor|LShift|RShift|Invert)",  # no operators of floats: every test stops at once
]
KERNELS = ("@kernel", "@parallel_kernel", "@borrowing_kernel", "@inline_kernel")  # without a compiler they do nothing
PLUGINS = "_hypothesis_pytestplugin,pytest_timeout"  # not those of ROS: they cost more than the tests
CONFIGURATION = """[cosmic-ray]
module-path = "{module}"
timeout = {timeout}
excluded-modules = []
test-command = "{command}"

[cosmic-ray.distributor]
name = "local"

[cosmic-ray.filters.operators-filter]
exclude-operators = {filtered}
"""


def copied_tree(place: Path) -> Path:
    """Return a fresh copy of the files git knows of: mutants are written over the source."""
    shutil.rmtree(place, ignore_errors=True)
    listed = subprocess.run(["git", "ls-files", "-z"], capture_output=True, check=True).stdout.decode().split("\0")
    for name in filter(None, listed):
        if name.startswith(("mech_twin/", "test/", "config/", "pyproject.toml")) and Path(name).is_file():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(name, place / name)
    return place


def test_command(python: Path, target: dict[str, Any]) -> str:
    """Return the command that must fail on a mutant; random inputs are the same each time."""
    tests = " ".join(target["tests"])
    hypothesis = "--hypothesis-seed=0 --hypothesis-profile=mutation"
    chosen = f"-m 'not slow and not browser' -k '{target.get('select', '')}'"
    run = f"{python} -m pytest -x -q -p no:cacheprovider {hypothesis} {chosen} {tests}"
    if target.get("jit"):
        return (
            f'sh -c \\"MECH_TWIN_CACHE_DIR=$(mktemp -d kernels.XXXXXX) {run}; code=$?; rm -rf kernels.*; exit $code\\"'
        )
    return run


def keep(session: Path, source: list[str], sample: int | None) -> None:
    """Mark as skipped what breaks nothing in plain Python, and all but so many of the rest; the same ones each time."""
    with use_db(session, WorkDB.Mode.open) as database:
        pending = sorted(
            (job.mutations[0].operator_name, job.mutations[0].occurrence, job.mutations[0].start_pos[0], job.job_id)
            for job in database.pending_work_items
        )
        compiled = [key for key in pending if key[0] == "core/RemoveDecorator" and source[key[2] - 1] in KERNELS]
        left = [key for key in pending if key not in compiled]
        random.Random(0).shuffle(left)
        skipped = [*compiled, *(left[sample:] if sample else [])]
        database.set_multiple_results([key[3] for key in skipped], WorkResult(WorkerOutcome.SKIPPED))


def counts(session: Path) -> str:
    """Return how many mutants there were, how many of them were run, and how many of those no test noticed."""
    with use_db(session, WorkDB.Mode.open) as database:
        outcomes = [result.test_outcome for _, result in database.results]
    run = [outcome for outcome in outcomes if outcome is not None]
    return f"{len(outcomes)} mutants, {len(run)} run, {run.count(TestOutcome.SURVIVED)} survived"


def mutated(python: Path, tools: Path, target: dict[str, Any]) -> bool:
    """Run one target and write its survivors; return whether its tests pass unbroken."""
    name, tree = target["name"], copied_tree(OUT / target["name"])
    command = test_command(python, target)

    def configure(timeout_s: float) -> None:
        text = CONFIGURATION.format(module=target["module"], timeout=timeout_s, command=command, filtered=FILTERED)
        (tree / "mutation.toml").write_text(text, encoding="utf-8")

    environment = {**os.environ, "PYTHONPATH": str(tree.absolute()), "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTEST_PLUGINS": PLUGINS}
    environment |= {} if target.get("jit") else {"NUMBA_DISABLE_JIT": "1"}

    def call(program: str, *words: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [tools / program, *words], cwd=tree, env=environment, text=True, capture_output=True, check=check
        )

    configure(600.0)
    began = time.monotonic()
    unbroken = call("cosmic-ray", "baseline", "mutation.toml", check=False)
    if unbroken.returncode:
        sys.stdout.write(f"{name}: its tests fail before anything is broken\n{unbroken.stdout}{unbroken.stderr}\n")
        return False
    configure(max(SHORTEST_TIMEOUT_S, TIMEOUT_OVER_BASELINE * (time.monotonic() - began)))
    call("cosmic-ray", "init", "mutation.toml", "session.sqlite")
    call("cr-filter-operators", "session.sqlite", "mutation.toml")
    session = tree / "session.sqlite"
    keep(session, (tree / target["module"]).read_text(encoding="utf-8").splitlines(), target.get("sample"))
    call("cosmic-ray", "exec", "mutation.toml", "session.sqlite")
    survivors = call("cr-report", "--surviving-only", "--show-diff", "session.sqlite").stdout
    OUT.joinpath(f"{name}.txt").write_text(survivors, encoding="utf-8")
    sys.stdout.write(f"{name}: {counts(session)} (build/mutation/{name}.txt)\n")
    sys.stdout.flush()
    return True


def main(project: Path, tools: Path, *names: str) -> int:
    """Return the exit code."""
    targets = tomllib.loads(Path(".ci", "mutation.toml").read_text(encoding="utf-8"))["target"]
    unknown = set(names) - {target["name"] for target in targets}
    if unknown:
        sys.stderr.write(f"no such target in .ci/mutation.toml: {', '.join(sorted(unknown))}\n")
        return 2
    wanted = [target for target in targets if not names or target["name"] in names]
    python = project.absolute() / "python"
    sound = [mutated(python, tools.absolute(), target) for target in wanted]
    return 0 if all(sound) else 1


if __name__ == "__main__":
    raise SystemExit(main(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:]))
