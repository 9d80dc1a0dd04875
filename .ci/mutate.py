"""Breaks the physics in small ways, one at a time, and lists what no test noticed (cosmic-ray, in a copy of the tree).

Usage: mutate.py VENV_BIN TOOLS_BIN [TARGET...]; targets stand in .ci/mutation.toml, all without one.
Writes build/mutation/TARGET.txt with the survivors and a line for each target; exit code 1 if a target's own tests fail
before anything is broken.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

OUT = Path("build", "mutation")
TIMEOUT_S = 120.0
# `float | None` in a signature: breaking it breaks nothing
FILTERED = ["core/ReplaceBinaryOperator_BitOr_.*"]
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
    run = f"{python} -m pytest -x -q -p no:cacheprovider --hypothesis-seed=0 -m 'not slow and not browser' {tests}"
    if target.get("jit"):
        return f'sh -c \\"NUMBA_CACHE_DIR=$(mktemp -d kernels.XXXXXX) {run}; code=$?; rm -rf kernels.*; exit $code\\"'
    return run


def mutated(python: Path, tools: Path, target: dict[str, Any]) -> bool:
    """Run one target and write its survivors; return whether its tests pass unbroken."""
    name, tree = target["name"], copied_tree(OUT / target["name"])
    command = test_command(python, target)
    text = CONFIGURATION.format(module=target["module"], timeout=TIMEOUT_S, command=command, filtered=FILTERED)
    (tree / "mutation.toml").write_text(text, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(tree.absolute()), "PYTHONDONTWRITEBYTECODE": "1"}
    environment |= {} if target.get("jit") else {"NUMBA_DISABLE_JIT": "1"}

    def call(program: str, *words: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [tools / program, *words], cwd=tree, env=environment, text=True, capture_output=True, check=check
        )

    unbroken = call("cosmic-ray", "baseline", "mutation.toml", check=False)
    if unbroken.returncode:
        sys.stdout.write(f"{name}: its tests fail before anything is broken\n{unbroken.stdout}{unbroken.stderr}\n")
        return False
    call("cosmic-ray", "init", "mutation.toml", "session.sqlite")
    call("cr-filter-operators", "session.sqlite", "mutation.toml")
    call("cosmic-ray", "exec", "mutation.toml", "session.sqlite")
    survivors = call("cr-report", "--surviving-only", "--show-diff", "session.sqlite").stdout
    OUT.joinpath(f"{name}.txt").write_text(survivors, encoding="utf-8")
    total = [line for line in survivors.splitlines() if line.startswith(("total jobs", "complete", "surviving"))]
    sys.stdout.write(f"{name}: {', '.join(total)} (build/mutation/{name}.txt)\n")
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
