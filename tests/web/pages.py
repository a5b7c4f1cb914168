"""A page of its own for a test: the real command in a process of its own, what it opened, and what a browser reads."""

import math
import re
import shutil
import subprocess
import sys
import threading
from contextlib import contextmanager

import pytest
from playwright.sync_api import expect

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update"),
]
PATIENCE_MS = 60_000

needs_browser = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium: install the package chromium, and the page is tried in it"
)


def opened_page(*arguments):
    """``aerodft view`` with these arguments; gives the address that it said."""
    return _opened("view", *arguments)


def opened_service(*arguments):
    """``aerodft serve --web`` with these arguments; gives the address that it said."""
    return _opened("serve", "--web", *arguments)


@contextmanager
def _opened(*words):
    command = [sys.executable, "-m", "aerodft", *map(str, words)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        said = process.stderr
        assert said is not None
        lines, reader = list[str](), None
        try:
            for line in said:
                lines.append(line)
                if found := re.search(r"open (http://\S+)", line):
                    break
            else:
                raise AssertionError("".join(lines))
            reader = threading.Thread(target=lambda: lines.extend(said))  # else it would wait to say more
            reader.start()
            yield found[1]
        finally:
            process.terminate()
            process.wait(30)
            if reader is not None:
                reader.join()  # before the pipe is closed under it, which would fail whatever test is running


def shown(browser, address, **options):
    context = browser.new_context(viewport={"width": 1280, "height": 800}, **options)
    tab, wrong = context.new_page(), []
    tab.on("pageerror", lambda error: wrong.append(str(error)))
    tab.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    tab.goto(address)
    tab.wait_for_selector("body[data-ready]", timeout=PATIENCE_MS)
    yield tab
    assert not wrong
    context.close()


def value_of(page, row=0):
    cell = page.locator("#measurements .value").nth(row)
    expect(cell).not_to_have_text("…", timeout=PATIENCE_MS)
    return cell.inner_text()


def copied(page, form):
    """What a copy of the shown image's numbers is; right after an image changed they are still of the one before."""
    expect(page.locator("#copies")).to_have_attribute("aria-busy", "false", timeout=PATIENCE_MS)
    page.click(f"[data-copy={form}]")
    return page.input_value("#copied")


def shown_number(value, low, high):
    """A number as the page shows it: with two digits of its interval."""
    return f"{value:.{min(max(1 - math.floor(math.log10(high - low)), 0), 6)}f}"


def shown_measurement(found):
    """A measurement of a length of ``aerodft measure --json``, as the page shows it."""
    low, high = found["ci95"]
    value, low_text, high_text = (shown_number(each, low, high) for each in (found["value"], low, high))
    return f"{value} m [{low_text} … {high_text}] 95 %"


def numbers(text):
    value, _, rest = text.partition(" ")
    low, high = rest.partition("[")[2].partition("]")[0].split(" … ")
    return float(value), float(low), float(high)
