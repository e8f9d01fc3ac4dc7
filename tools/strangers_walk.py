"""A stranger's walk: the tutorial, from an empty folder and with nothing but the commands that it prints.

A wheel is built from this repository into a fresh folder, as if it had been downloaded there. Every command of
docs/tutorial.md is then run in order, as a shell would: the ones that install, too. The command ``counterflex`` of this
environment is not on the path, and the caches of this user are not used. The panel is opened in Chromium at the link
that it prints; what it shows before, during and after the run is kept as pictures, with both reports. What a step
promises to write must be there. A command that is missing on the page makes a later one fail, and the walk with it.

The dependencies of the wheel are by default those of this environment, so that the walk works offline: the installing
command runs as printed, with ``PIP_NO_DEPS``. ``--registry`` lets it fetch them.

A stranger's computer compiles the numerical kernels first, some minutes of processor time. ``--cache DIR`` keeps them
for the next walk.

    python tools/strangers_walk.py [--out out/walk] [--registry] [--cache DIR]
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tools"), str(ROOT / "tests" / "references")]
from run_docs import Command, command_of  # noqa: E402

PAGE: Final = ROOT / "docs" / "tutorial.md"
MINE: Final = "tools/strangers_walk.py runs it"
"""Stands in the reason of a block that run_docs.py leaves out and the walk runs."""
PROMISED: Final = (
    "placed/cell.toml",
    "preflight/report.html",
    "plan/groove.src",
    "plan/groove.dat",
    "plan/report.html",
    "identified/cell.toml",
    "log/summary.json",
    "part/summary.json",
    "judged/report.html",
)
"""What the page says is there at the end."""
MOST_S: Final = 900.0
_BLOCK: Final = re.compile(r"(<!--[^>]*-->\n)?^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_LINK: Final = re.compile(r"^operator: (\S+)", re.MULTILINE)
_WAITS: Final = "preparing the loop"


class WalkFault(Exception):
    """A step that failed: what, and what it printed."""


@dataclass(frozen=True)
class Step:
    """Commands that run at the same time, in the order in which their terminals are opened."""

    commands: tuple[Command, ...]


def steps(text: str) -> Iterator[Step]:
    """Steps of a page: its console blocks, and the blocks whose reason names this tool."""
    for comment, language, body in _BLOCK.findall(text):
        lines = body.replace("\\\n", " ").splitlines()
        if language != "console" and MINE not in comment:
            continue
        if language != "console":
            yield from (Step((Command(line),)) for line in lines if line.strip())
            continue
        together: list[Command] = []
        for command in filter(None, map(command_of, lines)):
            if command.terminal:
                together.append(command)
                continue
            if together:
                yield Step(tuple(together))
                together = []
            yield Step((command,))
        if together:
            yield Step(tuple(together))


class Walk:
    """One walk through a page.

    Args:
        folder: Fresh folder that it runs in.
        pictures: Folder of the pictures.
        registry: Whether dependencies are fetched.
        cache: Folder of compiled kernels; None: a fresh one.
    """

    def __init__(self, folder: Path, pictures: Path, *, registry: bool, cache: Path | None = None) -> None:
        self.folder, self.pictures, self._registry = folder, pictures, registry
        home = folder / "home"
        home.mkdir()
        outside = [part for part in os.environ["PATH"].split(os.pathsep) if not (Path(part) / "counterflex").exists()]
        python = folder / "bin"  # what a stranger calls python3, wherever it is here
        python.mkdir()
        (python / "python3").symlink_to(Path(sys.base_prefix) / "bin" / "python3")
        kept = {key: os.environ[key] for key in ("LANG", "OPENBLAS_CORETYPE", "TERM") if key in os.environ}
        self.environment = {**kept, "HOME": str(home), "PATH": os.pathsep.join([str(python), *outside])}
        self.environment["PYTHONUNBUFFERED"] = "1"  # as in a terminal, which this is not
        if cache is not None:
            self.environment["COUNTERFLEX_CACHE"] = str(cache.resolve())
        if not registry:
            self.environment |= {"PIP_NO_DEPS": "1", "PIP_NO_INDEX": "1"}

    def run(self, step: Step) -> None:
        """Run one step.

        Raises:
            WalkFault: A command ended otherwise than the page says.
        """
        if len(step.commands) > 1:
            self._together(step.commands)
            return
        (command,) = step.commands
        if command.words.startswith("source "):
            said = self._shell(f"{command.words} && env -0", command)
            pairs = (line.partition("=") for line in said.split("\0") if "=" in line)
            self.environment = {name: value for name, _, value in pairs if name not in ("_", "PWD", "SHLVL")}
            return
        self._shell(command.words, command)
        if not self._registry and "-m venv " in command.words:
            self._lend(self.folder / shlex.split(command.words)[-1])

    def _lend(self, environment: Path) -> None:
        """Let an environment see the dependencies that this one has, and not its counterflex."""
        (site,) = environment.glob("lib/python*/site-packages")
        lent = [part for part in sys.path if part.endswith("site-packages")]
        (site / "lent.pth").write_text("\n".join(lent) + "\n", encoding="utf-8")

    def _shell(self, words: str, command: Command) -> str:
        ended = subprocess.run(
            ["bash", "-c", words], cwd=self.folder, env=self.environment, capture_output=True, text=True,
            timeout=MOST_S, check=False, stdin=subprocess.DEVNULL,
        )  # fmt: skip
        if ended.returncode not in command.exits:
            raise WalkFault(f"{command.words}\nexit {ended.returncode}\n{(ended.stdout + ended.stderr)[-3000:]}")
        return ended.stdout

    def _together(self, commands: tuple[Command, ...]) -> None:
        """Open terminals one after the other, as the page says: the panel, the loop once it waits, the robot."""
        terminals = [Terminal(command, self) for command in commands]
        watcher: Watcher | None = None
        try:
            for terminal in terminals:
                terminal.start()
                if "counterflex panel" in terminal.command.words:
                    link = _LINK.search(terminal.until(_LINK.search))
                    assert link is not None
                    watcher = Watcher(link[1], self.pictures)
                elif "counterflex run" in terminal.command.words:
                    terminal.until(lambda said: _WAITS in said)
            if watcher is not None:
                watcher.watch()
            for terminal in terminals:
                if not terminal.command.stopped:
                    terminal.wait()
            if watcher is not None:
                watcher.after()
            for terminal in terminals:
                if terminal.command.stopped:
                    terminal.interrupt()
        finally:
            if watcher is not None:
                watcher.close()
            for terminal in terminals:
                terminal.kill()


class Terminal:
    """A command in a terminal of its own.

    Args:
        command: The command.
        walk: Where it runs.
    """

    def __init__(self, command: Command, walk: Walk) -> None:
        self.command, self._walk = command, walk
        self._process: subprocess.Popen[str] | None = None
        self._said: list[str] = []
        self._new = threading.Condition()
        self._ended = False

    def start(self) -> None:
        """Start it."""
        words = ["bash", "-c", f"exec {self.command.words}"]
        self._process = subprocess.Popen(
            words, cwd=self._walk.folder, env=self._walk.environment, text=True, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        for line in self._process.stdout:
            with self._new:
                self._said.append(line)
                self._new.notify_all()
        with self._new:
            self._ended = True
            self._new.notify_all()

    def until(self, found: Callable[[str], Any]) -> str:
        """Wait until what it has printed satisfies a condition, and return that."""
        with self._new:
            self._new.wait_for(lambda: self._ended or found("".join(self._said)), MOST_S)
            said = "".join(self._said)
        if not found(said):
            raise WalkFault(f"{self.command.words}\nnever said what was waited for:\n{said[-3000:]}")
        return said

    def wait(self) -> None:
        """Wait for its end."""
        assert self._process is not None
        status = self._process.wait(MOST_S)
        if status not in self.command.exits and not (self.command.stopped and status == 130):
            raise WalkFault(f"{self.command.words}\nexit {status}\n{''.join(self._said)[-3000:]}")

    def interrupt(self) -> None:
        """Press Ctrl-C and wait."""
        assert self._process is not None
        self._process.send_signal(signal.SIGINT)
        self.wait()

    def kill(self) -> None:
        """End it, if it has not ended."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()
            self._process.wait()


class Watcher:
    """The operator's browser.

    Args:
        link: As the panel prints it.
        pictures: Folder for the pictures.
    """

    def __init__(self, link: str, pictures: Path) -> None:
        import browser

        browser.PATIENCE_S = MOST_S  # the loop may compile its kernels first
        self._pictures, self._browser = pictures, browser.Browser()
        self._page = self._browser.page()
        self._page.open(link)
        shown = "(document.querySelector('[data-test=\"state\"]') || {}).innerText"
        self._page.wait(f"!!{shown}", "the panel shows a state")
        self._keep("1-before")

    def _keep(self, name: str) -> None:
        self._page.screenshot(self._pictures / f"panel-{name}.png")

    def watch(self) -> None:
        """See the loop correct."""
        self._page.wait_text("state", "CORRECTING")
        share = "parseFloat((document.querySelector('[data-test=\"share\"]') || {}).innerText || '0') > 40"
        self._page.wait(f"{share} || !document.body.innerText.includes('CORRECTING')", "the groove is half cut")
        self._keep("2-correcting")

    def after(self) -> None:
        """See that the run has ended, and its report."""
        self._page.wait("!document.body.innerText.includes('CORRECTING')", "the run has ended")
        time.sleep(1.0)  # the report is drawn
        self._keep("3-after")

    def close(self) -> None:
        """Close the browser."""
        self._browser.__exit__()


def reports(folder: Path, pictures: Path) -> None:
    """Pictures of the reports that the walk has written."""
    from browser import Browser

    with Browser(1280, 1600) as browser:
        page = browser.page()
        for name in ("plan", "judged", "preflight"):
            page.open((folder / name / "report.html").as_uri())
            page.wait("document.readyState === 'complete' && document.body.innerText.length > 200", name)
            page.screenshot(pictures / f"report-{name}.png")


def build(folder: Path) -> Path:
    """Build the wheel of this repository into a folder."""
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps"]
    subprocess.run([*command, "--no-build-isolation", "--wheel-dir", str(folder), str(ROOT)], check=True)
    (wheel,) = folder.glob("counterflex-*.whl")
    return wheel


def main() -> int:
    """Walk, and say how it went."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "walk")
    parser.add_argument("--registry", action="store_true", help="fetch the dependencies, as a stranger does")
    parser.add_argument("--cache", type=Path, help="folder of compiled kernels, kept; without it none are there")
    chosen = parser.parse_args()
    out: Path = chosen.out.resolve()
    if out.exists():
        shutil.rmtree(out)
    folder, pictures = out / "folder", out / "pictures"
    folder.mkdir(parents=True)
    pictures.mkdir()
    print(f"wheel: {build(folder).name}", flush=True)
    walk = Walk(folder, pictures, registry=chosen.registry, cache=chosen.cache)
    begin, count = time.perf_counter(), 0
    try:
        for step in steps(PAGE.read_text(encoding="utf-8")):
            started = time.perf_counter()
            walk.run(step)
            count += len(step.commands)
            said = "; ".join(command.words for command in step.commands)
            print(f"  ok {time.perf_counter() - started:6.1f} s  {said}", flush=True)
        missing = [name for name in PROMISED if not (folder / name).exists()]
        if missing:
            raise WalkFault(f"the page promises {', '.join(missing)}")
        reports(folder, pictures)
    except WalkFault as fault:
        print(f"  FAILED {fault}")
        return 1
    print(f"stranger's walk: {count} commands in {time.perf_counter() - begin:.0f} s; pictures in {pictures}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
