# SPDX-License-Identifier: Apache-2.0
"""Chromium without a window, which reaches this machine alone, and the bench of a command in it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--no-proxy-server",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    # nothing but this machine is reachable
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
]
COMMAND = [sys.executable, "-c", "from mech_twin.cli.main import main; main()"]
UP_MS = 120_000
CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "chrome")


def chromium() -> str:
    """Return the browser's binary: ``CHROMIUM`` of the environment, else the first one on the path."""
    named = os.environ.get("CHROMIUM")
    found = [named] if named else [path for name in CHROMIUM if (path := shutil.which(name))]
    if not found:
        raise FileNotFoundError("no Chromium on the path; install it or name it in the variable CHROMIUM")
    return found[0]


@contextmanager
def running(*words: str, folder: Path):
    """Yield the address of the bench of a command that runs, and the process."""
    process = subprocess.Popen(
        [*COMMAND, *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, cwd=folder
    )
    try:
        url = next(line.split("view: ", 1)[1].strip() for line in process.stderr if line.startswith("view: "))
        drain = threading.Thread(target=process.stderr.read, daemon=True)
        drain.start()
        yield url, process
    finally:
        process.terminate()
        code = process.wait(30)
        drain.join()
        process.stderr.close()
    assert code == 0


@contextmanager
def opened(browser, url, *, shows=True):
    """Yield a page of a window of its own, with the lines the browser wrote about errors."""
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    page = context.new_page()
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    page.goto(url)
    if shows:
        page.wait_for_function("() => window.bench.shown > 0.2", timeout=UP_MS)
    yield page
    context.close()
    assert errors == []
