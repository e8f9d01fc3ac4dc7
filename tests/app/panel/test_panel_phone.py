"""The page on a phone: the buttons are on the screen, and nothing that is said lies over them."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest

from browser import Browser, Page, chromium

pytest.importorskip("nicegui", reason="the extra panel is not installed")
pytestmark = [
    pytest.mark.skipif(chromium() is None, reason="no Chromium on this computer"),
    pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="processes cannot be stopped here"),
]
SCREENS = [(390, 844), (390, 600), (844, 390)]
_SEEN = """JSON.stringify([...document.querySelectorAll('[data-test="stop"],[data-test="arm"]')].map((item) => {
  const b = item.getBoundingClientRect();
  const middle = [(b.left + b.right) / 2, (b.top + b.bottom) / 2];
  const corners = [[b.left + 12, b.top + 12], [b.right - 12, b.bottom - 12], middle];
  return b.left >= 0 && b.top >= 0 && b.right <= innerWidth && b.bottom <= innerHeight
    && corners.every(([x, y]) => item.contains(document.elementFromPoint(x, y)));
}))"""


def require_reachable(page: Page, when: str) -> None:
    """RAMP OUT and ARM lie on the screen, and a finger on them touches nothing else."""
    assert json.loads(page.value(_SEEN)) == [True, True], when


@pytest.fixture(scope="module")
def panel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A panel of a folder without a run, and the operator's link."""
    folder = tmp_path_factory.mktemp("panel")
    command = [sys.executable, "-m", "counterflex", "panel", str(folder / "log"), "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as made:
        assert made.stdout is not None
        links = dict(made.stdout.readline().strip().split(": ", 1) for _ in range(2))
        yield made, links["operator"]
        made.kill()
        made.communicate()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with Browser() as made:
        yield made


@pytest.mark.parametrize("screen", SCREENS)
def test_nothing_covers_the_buttons(
    panel: tuple[subprocess.Popen[str], str], browser: Browser, screen: tuple[int, int]
) -> None:
    process, link = panel
    page = browser.page()
    width, height = screen
    page.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=True)
    page.open(link)
    page.wait_text("state", "NO RUN")
    require_reachable(page, "without a run")
    assert page.value("document.documentElement.scrollWidth") <= width
    assert not page.there("log-written")
    assert "remaining (model)" in str(page.value("document.querySelector('.cf-live').textContent"))
    page.click("stop")  # refused: no run goes on
    page.wait("!!document.querySelector('.q-notification')", "the refusal is said")
    require_reachable(page, "beside a message")
    page.click("arm")
    page.wait("!!document.querySelector('[data-test=\"no\"]')", "arming is asked for twice")
    require_reachable(page, "beside a question")
    page.click("no")
    process.send_signal(signal.SIGSTOP)
    try:
        page.wait_text("lost", "NO CONNECTION")
        require_reachable(page, "beside the banner")
    finally:
        process.send_signal(signal.SIGCONT)
    page.open("about:blank")
