"""A real headless Chromium for the tests of pages, which are skipped where there is none."""

import os
from shutil import which

import pytest

# WebGL on the processor: a test machine has no graphics adapter.
FLAGS = [
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--ignore-gpu-blocklist",
    "--no-sandbox",
]
# WebGPU likewise, for the live page.
FLAGS += ["--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"]
NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")


def _missing(reason):
    if os.environ.get("CLOTHSIM_TEST_VIEW"):
        pytest.fail(reason)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def browser():
    """Return Chromium, driven by playwright. `make test-view` installs both."""
    program = next(filter(None, map(which, NAMES)), None)
    if program is None:
        _missing(
            f"no Chromium: none of {', '.join(NAMES)} is on the PATH (`make test-view` installs it)"
        )
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        _missing("playwright is not installed (`make test-view` installs it)")
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, args=FLAGS)
        yield chromium
        chromium.close()


class Opened:
    """A page, with what it said and asked for."""

    def __init__(self, browser, path, **options):
        self.said, self.asked = [], []
        self.context = browser.new_context(viewport={"width": 760, "height": 640}, **options)
        self.tab = self.context.new_page()
        self.tab.set_default_timeout(
            300_000
        )  # ms; only a page that hangs takes so long, on a busy machine too
        self.tab.on("console", lambda message: self.said.append(message.text))
        self.tab.on("pageerror", lambda error: self.said.append(str(error)))
        self.tab.on("request", lambda request: self.asked.append(request.url))
        self.tab.goto(path.as_uri())

    def ready(self):
        """Return the milliseconds from the start of loading to the first picture."""
        self.tab.wait_for_selector("body[data-ready]")
        return int(self.tab.evaluate("document.body.dataset.ready"))


@pytest.fixture
def opened(browser):
    """Return `opened(path)`: the page of that file, in a fresh context."""
    pages = []

    def open_page(path, **options):
        pages.append(Opened(browser, path, **options))
        return pages[-1]

    yield open_page
    for page in pages:
        page.context.close()
