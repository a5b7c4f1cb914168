"""The browser that the page is tried in."""

import pytest
from playwright.sync_api import sync_playwright

from tests.web.pages import CHROMIUM, FLAGS


@pytest.fixture(scope="module")
def browser():
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()
