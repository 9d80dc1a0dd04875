# SPDX-License-Identifier: Apache-2.0
"""What an installation's size is made of: the packages behind each extra, and the largest of them.

``python benchmarks/installation.py [--write]`` looks at this environment.  A package is counted where it is first
needed, in the order of the table: what the base brings is not counted again for an extra.
"""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, distribution

from comparison import Table, measure
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PACKAGE, LARGEST = "mech_twin", 3
GROUPS = {
    "": "the twin without ROS: library, `simulate`, `study`, `analyse`",
    "jazzy": "ROS 2: `run`, `replay`, `shadow`, `monitor`",
    "view": "rerun: `run --view`, `view`",
    "plots": "`analyse --plots`, `compare`, figures",
    "tables": "Parquet",
    "pandas": "results as data frames",
    "cluster": "sweeps on several hosts",
    "alerts": "`shadow --mqtt --prometheus`",
    "test": "tests, lint, types",
    "bench": "the peers of the benchmarks",
}


def needed(names: list[Requirement], known: dict[str, int]) -> dict[str, int]:
    """Return the size (bytes) of every package that is needed and not known yet, by name."""
    found: dict[str, int] = {}
    waiting = list(names)
    while waiting:
        wanted = waiting.pop()
        name = canonicalize_name(wanted.name)
        if name in known or name in found:
            continue
        try:
            there = distribution(wanted.name)
        except PackageNotFoundError:
            raise SystemExit(f"installation: {wanted.name} is not installed: pip install -e '.[bench]'") from None
        found[name] = sum(size_of(file) for file in there.files or ())
        asked = [Requirement(text) for text in there.requires or ()]
        waiting += [r for r in asked if applies(r, wanted.extras)]
    return found


def size_of(file: object) -> int:
    """Return the size of an installed file (bytes), 0 where it is no longer there."""
    place = file.locate()  # type: ignore[attr-defined]
    return int(place.stat().st_size) if place.is_file() else 0


def applies(requirement: Requirement, extras: set[str]) -> bool:
    """Tell whether a requirement counts here, with these extras."""
    marker = requirement.marker
    return marker is None or any(marker.evaluate({"extra": extra}) for extra in extras or {""})


def measured() -> list[Table]:
    """Return the table."""
    own = [Requirement(text) for text in distribution(PACKAGE).requires or ()]
    known: dict[str, int] = {}
    rows: list[tuple[object, ...]] = []
    for extra, purpose in GROUPS.items():
        base = [r for r in own if applies(r, {extra}) and (r.marker is None) == (extra == "")]
        sizes = needed(base, known)
        largest = sorted(sizes.items(), key=lambda item: -item[1])[:LARGEST]
        parts = ", ".join(f"{name} {size / 1e6:.0f}" for name, size in largest)
        rows.append(
            (f"`[{extra}]`" if extra else "base", purpose, len(sizes), f"{sum(sizes.values()) / 1e6:.0f}", parts)
        )
        known |= sizes
    rows.append(("all", "", len(known), f"{sum(known.values()) / 1e6:.0f}", ""))
    how = "Megabytes on disk, compiled Python files included where they are listed by their package."
    return [Table(how, ("extra", "what for", "packages", "MB", "largest, MB"), rows)]


if __name__ == "__main__":
    measure("installation", measured)
