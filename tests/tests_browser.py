"""A real browser, for the tests of pages and films."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

import pytest


@contextmanager
def chromium(*arguments: str) -> Iterator:
    """Playwright's browser without a screen; where that or Chromium is missing the test is skipped."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="needs flightdepth[browser]")
    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if path is None:
        pytest.skip("needs chromium")
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=["--no-sandbox", *arguments])
        yield browser
        browser.close()
