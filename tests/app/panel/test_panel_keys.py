"""Keys on the page in a real browser, whatever has the focus; no run goes on, so that every request is refused."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from browser import Browser, chromium

pytest.importorskip("nicegui", reason="the extra panel is not installed")
pytestmark = pytest.mark.skipif(chromium() is None, reason="no Chromium on this computer")
COUNT = "[...document.querySelectorAll('.cf-actions .cf-small')].filter(e => e.innerText.includes('{}')).length == {}"


@pytest.mark.long
def test_keys_ramp_out_whatever_has_the_focus(tmp_path: Path) -> None:
    """A button that was clicked, a button that Tab has reached, and a question take no key away."""
    command = [sys.executable, "-m", "counterflex", "panel", str(tmp_path / "log"), "--port", "0"]
    panel = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert panel.stdout is not None
        links = dict(panel.stdout.readline().strip().split(": ", 1) for _ in range(2))
        with Browser(draws=False) as browser:
            page = browser.page()
            page.open(links["operator"])
            page.wait_text("state", "NO RUN")
            page.click("arm")
            page.wait("!!document.querySelector('[data-test=\"no\"]')", "arming is asked for twice")
            page.click("no")
            page.wait("!document.querySelector('[data-test=\"no\"]')", "the question is gone")
            page.press("s")
            page.wait(COUNT.format("RAMP OUT", 1), "s ramps out after arming by mouse")
            page.click("stop")
            page.wait(COUNT.format("RAMP OUT", 2), "so does the button")
            page.press("s")
            page.wait(COUNT.format("RAMP OUT", 3), "s ramps out behind a click")
            page.tab_to("arm")
            assert page.value("document.activeElement.tagName") == "BUTTON"
            page.press("S")
            page.wait(COUNT.format("RAMP OUT", 4), "S, as Caps Lock makes it, while a button has the focus")
            page.press("Escape")
            page.wait(COUNT.format("RAMP OUT", 5), "Esc")
            page.press("A")
            page.wait("!!document.querySelector('[data-test=\"yes\"]')", "A asks before it arms")
            page.press("s")
            page.wait(COUNT.format("RAMP OUT", 6), "s while the question stands there")
        panel.send_signal(signal.SIGINT)
        _, errors = panel.communicate()
        assert errors == ""  # a server that is ended by Ctrl-C has left nothing unwritten
    finally:
        if panel.poll() is None:
            panel.kill()
            panel.communicate()
