# SPDX-License-Identifier: Apache-2.0
"""``mech-twin bench``: the bench without a run, with machines, pages and recordings to open."""

from __future__ import annotations

from mech_twin.cli.console import say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.live_view import hold_view
from mech_twin.cli.pages import shipped_pages
from mech_twin.cli.verbs import BenchVerb
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.nodes.run.domain import settle_domain
from mech_twin.parameters.load import PAGE, PAGE_SUFFIXES
from mech_twin.process.dependencies import require_modules


def open_bench(asked: BenchVerb) -> None:
    """Open the bench on a folder of recordings until stopped."""
    folder = asked.folder
    if not folder.is_dir():
        raise CommandError(f"{folder}: expected a directory of recordings")
    require_modules("aiohttp")
    settle_domain()
    from mech_twin.view.bench.started import StartedBench

    own = sorted(path.name for suffix in PAGE_SUFFIXES for path in folder.glob(f"*{suffix}"))
    machines = [*(name for name in CATALOGUE if name != PAGE.name), *own, *map(str, shipped_pages().values())]
    hall = {"folder": str(folder.resolve()), "machines": machines}
    with StartedBench(asked.port or None, hall=hall, history_bytes=512 << 20, announce=say) as bench:
        say(f"view: {bench.url}")
        hold_view(bench.url)
