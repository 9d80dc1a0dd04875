# SPDX-License-Identifier: Apache-2.0
"""The browser that the tests of the bench share."""

import pytest
from browser import FLAGS, chromium


@pytest.fixture(scope="module")
def browser():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        found = play.chromium.launch(executable_path=chromium(), headless=True, args=FLAGS)
        yield found
        found.close()
