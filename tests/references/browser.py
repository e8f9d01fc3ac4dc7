"""A real browser for tests: headless Chromium, driven over its remote debugging port; no further package is needed."""

from __future__ import annotations

import base64
import contextlib
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any, Self

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE_S = 180.0
_POLL_S = 0.05


def chromium() -> str | None:
    """Path of a Chromium of this computer, or None."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


class Page:
    """One page of a browser.

    Args:
        address: Of its debugging socket.
    """

    def __init__(self, address: str) -> None:
        from simple_websocket import Client

        self._socket: Any = Client(address, max_message_size=1 << 26)
        self._count = 0
        for domain in ("Page", "Runtime", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method of the debugging protocol and wait for its result."""
        self._count += 1
        self._socket.send(json.dumps({"id": self._count, "method": method, "params": params}))
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            text = self._socket.receive(timeout=PATIENCE_S)
            if text is None:
                break
            message = json.loads(text)
            if message.get("id") == self._count:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']}")
                result: dict[str, Any] = message["result"]
                return result
        raise TimeoutError(method)

    def open(self, address: str) -> None:
        """Go to an address."""
        self.call("Page.navigate", url=address)

    def value(self, expression: str) -> Any:
        """Value of a JavaScript expression; None where it fails."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        return answer["result"].get("value") if "exceptionDetails" not in answer else None

    def text(self, name: str) -> str:
        """Text of the element that is marked for tests by a name; empty without one."""
        return str(self.value(f"(document.querySelector('[data-test=\"{name}\"]') || {{}}).innerText || ''"))

    def there(self, name: str) -> bool:
        """Whether there is an element of that name."""
        return bool(self.value(f"!!document.querySelector('[data-test=\"{name}\"]')"))

    def click(self, name: str) -> None:
        """Click on the middle of an element as a mouse does, again while nothing of it reaches the element.

        What opens or closes moves, or lies under another thing for a moment: such a click goes elsewhere.
        """
        element = f"document.querySelector('[data-test=\"{name}\"]')"
        place = f"""(() => {{ const e = {element}, r = e.getBoundingClientRect();
            const x = r.x + r.width / 2, y = r.y + r.height / 2, top = document.elementFromPoint(x, y);
            if (!top || !e.contains(top)) return null;
            e.listens ||= !e.addEventListener('click', () => {{ window.clicked = '{name}'; }}, true);
            return [x, y]; }})()"""
        self.call("Page.bringToFront")
        self.value("window.clicked = ''")
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            before = self.value(place)
            time.sleep(_POLL_S)
            if before is None or self.value(place) != before:  # it is still moving into its place
                continue
            for kind in ("mousePressed", "mouseReleased"):
                self.call("Input.dispatchMouseEvent", type=kind, x=before[0], y=before[1], button="left", clickCount=1)
            if self.value("window.clicked") != "":  # or the page is another one by now
                return
        raise TimeoutError(f"{name} cannot be clicked; the page says: {self.value('document.body.innerText')}")

    def press(self, key: str) -> None:
        """Press and release a key; an upper-case letter is what Caps Lock makes of it."""
        self.call("Page.bringToFront")
        letter = len(key) == 1
        code, number = (
            (f"Key{key.upper()}", ord(key.upper())) if letter else (key, {"Tab": 9, "Escape": 27}.get(key, 0))
        )
        text = {"text": key, "unmodifiedText": key} if letter else {}
        for kind, more in (("keyDown", text), ("keyUp", {})):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=code, windowsVirtualKeyCode=number, **more)

    def tab_to(self, name: str) -> None:
        """Press Tab until an element has the focus."""
        for _ in range(20):
            self.press("Tab")
            if self.value("document.activeElement.dataset.test") == name:
                return
        raise TimeoutError(f"{name} does not get the focus")

    def wait(self, expression: str, what: str = "", patience_s: float = PATIENCE_S) -> Any:
        """Wait until an expression is true, and give its value."""
        end = time.monotonic() + patience_s
        while time.monotonic() < end:
            with contextlib.suppress(RuntimeError):
                if value := self.value(expression):
                    return value
            time.sleep(_POLL_S)
        raise TimeoutError(f"{what or expression}; the page says: {self.value('document.body.innerText')}")

    def wait_text(self, name: str, word: str) -> None:
        """Wait until an element shows a word."""
        element = f"(document.querySelector('[data-test=\"{name}\"]') || {{}})"
        self.wait(f"({element}.innerText || '').includes({json.dumps(word)})", f"{name} shows {word}")

    def offline(self, off: bool) -> None:
        """Take the network away from the page, or give it back."""
        conditions = {"latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
        self.call("Network.emulateNetworkConditions", offline=off, **conditions)

    def screenshot(self, file: Path) -> None:
        """Write what is seen as PNG."""
        data = self.call("Page.captureScreenshot", format="png")["data"]
        file.write_bytes(base64.b64decode(data))

    def close(self) -> None:
        """Leave the page."""
        with contextlib.suppress(Exception):
            self._socket.close()


class Browser:
    """A headless Chromium with a profile of its own.

    Args:
        width: Of the window, px.
        height: Of the window, px.
        draws: In 3-D as well. Without a graphics card that takes a core per page.
    """

    def __init__(self, width: int = 1280, height: int = 800, *, draws: bool = True) -> None:
        program = chromium()
        if program is None:
            raise FileNotFoundError("no Chromium on this computer")
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        profile = Path(self._folder.name)
        options = [
            "--headless=new", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader", "--no-first-run",
            "--disable-extensions", "--disable-background-networking", "--ignore-certificate-errors",
            f"--window-size={width},{height}", f"--user-data-dir={profile}", "--remote-debugging-port=0",
            "--remote-allow-origins=*", "--disable-background-timer-throttling", "--disable-renderer-backgrounding",
            "--disable-backgrounding-occluded-windows", *([] if draws else ["--disable-3d-apis"]),
        ]  # fmt: skip
        self._process = subprocess.Popen(
            [program, *options, "about:blank"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        port_file = profile / "DevToolsActivePort"
        end = time.monotonic() + PATIENCE_S
        while not (port_file.exists() and port_file.read_text().count("\n")):
            if time.monotonic() > end or self._process.poll() is not None:
                raise TimeoutError("Chromium does not start")
            time.sleep(_POLL_S)
        self._port = int(port_file.read_text().split("\n")[0])
        self._pages: list[Page] = []

    def page(self) -> Page:
        """A new page; pages of one browser share their cookies."""
        found = self._get("/json/new?about:blank", "PUT")
        page = Page(found["webSocketDebuggerUrl"])
        self._pages.append(page)
        return page

    def _get(self, path: str, method: str = "GET") -> Any:
        request = urllib.request.Request(f"http://127.0.0.1:{self._port}{path}", method=method)
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return json.loads(answer.read())

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for page in self._pages:
            page.close()
        self._process.kill()
        self._process.wait()
        self._folder.cleanup()
