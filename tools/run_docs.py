"""Run every command printed in the docs and every example, as a reader would, and fail when one fails.

Commands are the lines that begin with ``$ `` in fenced ``console`` blocks of README.md, CONTRIBUTING.md and docs/. The
commands of one page run in order in one fresh folder, several pages at a time; it holds copies of ``examples/`` and
``tests/outside/``, and for README.md nothing: what it uses, its own commands must have made. A page with
``<!-- goes on from: README.md -->`` begins with what the commands of that page have left. Examples are those of
``examples/*.py`` that no page runs.

Lines that begin with ``1$ ``, ``2$ ``, ... belong in a terminal each: these run at the same time.

What stands behind a command says how it is run here:

- ``# exit 2``: it is meant to end so; ``# exit 0 or 1``: this depends on the machine.
- ``# quick: --minutes 0.1``: it takes long, and is run with these options added.
- ``# Ctrl-C``: it ends by that alone, here when the other terminals have ended.
- ``# long``: it takes minutes, and no other command needs what it makes.

With ``--turn`` a page or example is run where it has its turn (:mod:`thirds`); those that readers begin with always
are, without what is long, and so are pages that others go on from.

Each ``counterflex`` command is started as a shell would start it where it is met first, and so are those of several
terminals. From then on it runs in processes that have the libraries loaded already (:mod:`loaded_commands`): importing
them takes longer than many of the commands.

Every ``python`` block is run by itself, in its order among the commands of the page and in the same folder: it brings
its own imports.

A ``counterflex`` command in any other block is not run. Why not is said before the block, ``<!-- not run: reason -->``;
without a reason it is a fault. With a reason a ``python`` block is not run either.

    python tools/run_docs.py [--turn | PAGE ...]
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import textwrap
import threading
import time
from collections import Counter
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

sys.path.insert(0, str(Path(__file__).parent))
import loaded_commands
import thirds

ROOT = Path(__file__).resolve().parents[1]
FROM_NOTHING = ("README.md",)
"""Pages that a reader follows from an empty folder."""
ALWAYS = ("README.md", "CONTRIBUTING.md", "docs/first-hour.md")
"""Pages that are run at each commit."""
_BLOCK = re.compile(r"^[ \t]*```(\w*)[^\n]*\n(.*?)^[ \t]*```|^((?:(?: {4}|\t)[^\n]*\n)+)", re.MULTILINE | re.DOTALL)
_PROMPT = re.compile(r"(\d*)\$ (.*)")
_MARK = re.compile(
    r"\s+# (exit (?P<exit>\d+(?: or \d+)*)|quick: (?P<quick>.*?)|(?P<stopped>Ctrl-C)|(?P<long>long))\s*$"
)
_REASON = re.compile(r"<!-- not run: ((?:(?!-->).)+?) -->\s*\Z", re.DOTALL)
_BASE = re.compile(r"<!-- goes on from: (\S+) -->")
_MOST_S = 900.0
_SCRIPT = "counterflex"
_STOPPED_S = 60.0
"""How long a command may take to end once it has been interrupted."""
_AT_ONCE = threading.Lock()
"""Programs of several terminals talk over fixed ports: one group at a time, and whatever else opens such a port."""
_MET: set[str] = set()
"""Commands that have been started as a shell would start them."""
_PORTS = re.compile(r"counterflex (run|operator|tracker|ads|twin (?!measure|track |scenarios))\b")
"""Commands that open a port."""


@dataclass(frozen=True)
class Command:
    """One printed command."""

    words: str  # as it is run
    terminal: str = ""  # number of its terminal; empty: the only one
    exits: tuple[int, ...] = (0,)  # exit statuses that are right
    stopped: bool = False  # it is ended by Ctrl-C
    shown: str = ""  # what is printed in place of the words, where they are long
    is_long: bool = False  # it takes minutes


@dataclass
class Page:
    """Commands and outputs printed on a page."""

    # commands that run at the same time, by terminal; one after the other within it
    steps: list[dict[str, list[Command]]] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)  # reasons of commands that are not run
    unexplained: list[str] = field(default_factory=list)  # commands that are not run without a reason


def command_of(line: str) -> Command | None:
    """The command of a line of a console block; None where it is output."""
    found = _PROMPT.match(line)
    if found is None:
        return None
    terminal, words = found.groups()
    exits: tuple[int, ...] = (0,)
    stopped = is_long = False
    while mark := _MARK.search(words):
        words = words[: mark.start()]
        if mark["exit"]:
            exits = tuple(int(part) for part in mark["exit"].split(" or "))
        elif mark["quick"]:
            words += f" {mark['quick']}"
        elif mark["stopped"]:
            stopped = True
        else:
            is_long = True
    return Command(words.strip(), terminal, exits, stopped, is_long=is_long)


def read_page(text: str) -> Page:
    """Commands of a page in order."""
    page = Page()
    for block in _BLOCK.finditer(text):
        language, body = block[1] or "", block[2] if block[2] is not None else block[3]
        lines = [line.strip() for line in body.replace("\\\n", " ").splitlines()]
        reason = _REASON.search(text[: block.start()])
        if language == "python" and reason is None:
            number = text.count("\n", 0, block.start()) + 1
            words = shlex.join(["python", "-c", textwrap.dedent(body)])
            page.steps.append({"": [Command(words, shown=f"python block in line {number}")]})
        elif language != "console":
            plain = [body] if language == "python" else [line for line in lines if line.startswith("counterflex ")]
            if reason:
                page.left_out[" ".join(reason[1].split())] += len(plain)
            else:
                page.unexplained += plain
        else:
            page.steps += _steps(lines)
    return page


def _steps(lines: list[str]) -> list[dict[str, list[Command]]]:
    """Steps of a console block."""
    steps: list[dict[str, list[Command]]] = []
    together = False
    for command in filter(None, map(command_of, lines)):
        if not (command.terminal and together):
            steps.append({})
        together = bool(command.terminal)
        steps[-1].setdefault(command.terminal, []).append(command)
    return steps


def _environment() -> dict[str, str]:
    return dict(os.environ, PATH=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")


class _Terminal(threading.Thread):
    """Runs the commands of one terminal, one after the other."""

    def __init__(self, commands: list[Command], folder: Path, alone: threading.Event, forks: Any) -> None:
        super().__init__(daemon=True)
        self.said: list[str] = []
        self.faults = 0
        self._commands, self._folder, self._alone, self._forks = commands, folder, alone, forks

    @property
    def waits(self) -> bool:
        """Return whether it ends by Ctrl-C alone."""
        return any(command.stopped for command in self._commands)

    def run(self) -> None:
        for command in self._commands:
            ok, said = _run(command, self._folder, self._alone, self._forks)
            self.faults += not ok
            self.said.append(said)


def _run(command: Command, folder: Path, alone: threading.Event, forks: Any) -> tuple[bool, str]:
    """Run one command: whether it ended as wanted, and what to print: time, and else its output."""
    begin = time.perf_counter()
    words = shlex.split(command.words)
    if "|" in words:
        words = ["bash", "-c", command.words]
    name = "".join(words[1:2])
    is_met = name in _MET
    if words[0] == _SCRIPT:
        _MET.add(name)
    with tempfile.NamedTemporaryFile("w+") as output:
        if forks is not None and words[0] == _SCRIPT and is_met and not command.stopped:
            status = loaded_commands.ended(forks, words, folder, _environment(), Path(output.name), _MOST_S)
        else:
            status = _ended(command, words, folder, output, alone)
        output.seek(0)
        printed = output.read()
    ok = status in command.exits or (command.stopped and status == 130)
    place = f"[{command.terminal}] " if command.terminal else ""
    said = f"  {'ok' if ok else 'FAILED'} {time.perf_counter() - begin:6.1f} s  {place}{command.shown or command.words}"
    if not ok:
        said += f"\nexit {status}, wanted {' or '.join(map(str, command.exits))}\n{printed[-4000:]}"
    return ok, said


def _ended(command: Command, words: list[str], folder: Path, output: IO[str], alone: threading.Event) -> int | str:
    """Run one command as a shell would: its exit status, or what became of it."""
    process = subprocess.Popen(words, cwd=folder, env=_environment(), stdout=output, stderr=subprocess.STDOUT)
    try:
        if command.stopped:
            alone.wait(_MOST_S)
            process.send_signal(signal.SIGINT)
        return process.wait(_STOPPED_S if command.stopped else _MOST_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
        return f"did not end in {_STOPPED_S if command.stopped else _MOST_S:g} s"


def run_step(step: dict[str, list[Command]], folder: Path, forks: Any = None) -> tuple[int, list[str]]:
    """Run the terminals of a step at the same time: how many commands failed, and what to print.

    Args:
        step: Commands by terminal.
        folder: Working folder.
        forks: Where processes of a single terminal come from (:func:`loaded_commands.context`); None: new ones.
    """
    alone = threading.Event()
    terminals = [_Terminal(commands, folder, alone, forks if len(step) == 1 else None) for commands in step.values()]
    ports = any(_PORTS.match(command.words) for commands in step.values() for command in commands)
    with _AT_ONCE if len(terminals) > 1 or ports else threading.Lock():
        for terminal in terminals:
            terminal.start()
        for terminal in terminals:
            if not terminal.waits:
                terminal.join()
        alone.set()
        for terminal in terminals:
            terminal.join()
    return sum(terminal.faults for terminal in terminals), [line for terminal in terminals for line in terminal.said]


def base_of(path: Path) -> Path | None:
    """The page whose results a page begins with; None where it begins with none."""
    found = _BASE.search(path.read_text(encoding="utf-8")) if path.suffix == ".md" else None
    return ROOT / found[1] if found else None


def _folder_of(path: Path, work: Path) -> Path:
    return work / str(path).replace(os.sep, "-").strip("-")


def without_long(page: Page, path: str, now: thirds.Turn | None) -> Page:
    """The page without its long commands where it has not its turn; None: all have."""
    if now is None or now.takes(path):
        return page
    short = [{t: [c for c in commands if not c.is_long] for t, commands in step.items()} for step in page.steps]
    left_out = sum(command.is_long for step in page.steps for commands in step.values() for command in commands)
    reasons = page.left_out + Counter({"long, and it is another third's turn": left_out})
    return Page([step for step in short if any(step.values())], reasons, page.unexplained)


def run_page(
    path: Path, work: Path, forks: Any = None, now: thirds.Turn | None = None
) -> tuple[int, int, Counter[str], str]:
    """Run the commands of a page, or an example: how many, how many failed, what was left out, what to print.

    Args:
        path: Of the page.
        work: Folder that holds the folders of all pages; the page that it goes on from has been run there.
        forks: Where processes of commands that have been met come from; None: new ones.
        now: Whose turn it is, of what takes long; None: everybody's.
    """
    named = str(path.relative_to(ROOT)) if path.is_relative_to(ROOT) else str(path)
    if path.suffix == ".py":
        page = Page([{"": [Command(f"{shlex.quote(sys.executable)} {shlex.quote(str(path))}")]}])
    else:
        page = without_long(read_page(path.read_text(encoding="utf-8")), named, now)
    lines, count = [named], sum(len(commands) for step in page.steps for commands in step.values())
    lines += [f"  FAILED: neither run nor said why: {words}" for words in page.unexplained]
    faults = len(page.unexplained)
    folder, base = _folder_of(path, work), base_of(path)
    folder.mkdir()
    if base is not None:
        shutil.copytree(_folder_of(base, work), folder, dirs_exist_ok=True)
    if page.steps and path.suffix != ".py" and named not in FROM_NOTHING:
        for copied in ("examples", "tests/outside"):
            shutil.copytree(ROOT / copied, folder / copied, dirs_exist_ok=True)
    for step in page.steps:
        failed, said = run_step(step, folder, forks)
        faults += failed
        lines += said
    return count, faults, page.left_out, "\n".join(lines) if len(lines) > 1 else ""


def _run_behind(
    base: Future[Any] | None, page: Path, work: Path, forks: Any, now: thirds.Turn | None
) -> tuple[int, int, Counter[str], str]:
    """:func:`run_page`, when the page that it goes on from has been run."""
    if base is not None:
        base.result()
    return run_page(page, work, forks, now)


def all_pages() -> list[Path]:
    """All pages, then the examples that are run on none of them."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    steps = (step for page in pages for step in read_page(page.read_text(encoding="utf-8")).steps)
    words = {command.words for step in steps for commands in step.values() for command in commands}
    return pages + [p for p in sorted((ROOT / "examples").glob("*.py")) if f"python examples/{p.name}" not in words]


def of_the_turn(pages: list[Path], now: thirds.Turn) -> list[Path]:
    """Pages and examples to run at a commit: of its turn, of every turn, and those that any of these goes on from."""
    taken = [page for page in pages if (name := page.relative_to(ROOT).as_posix()) in ALWAYS or now.takes(name)]
    bases = set(map(base_of, taken))
    return [page for page in pages if page in taken or page in bases]


def main(pages: list[str]) -> int:
    """Run the given pages, or all pages and all examples, several at a time."""
    now, pages = (thirds.turn(), []) if pages == ["--turn"] else (None, pages)
    chosen = [Path(page).resolve() for page in pages] or all_pages()
    if now is not None:
        every, chosen = len(chosen), of_the_turn(chosen, now)
        print(f"{len(chosen)} of {every} pages and examples, {thirds.said(now)}; all pages: make docs")
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # started in the background: what is run here inherits that
        signal.signal(signal.SIGINT, signal.default_int_handler)
    forks = loaded_commands.context(many=not pages)
    count, faults, left_out = 0, 0, Counter[str]()
    later = [page for page in chosen if base_of(page) is not None]
    first = [page for page in chosen if page not in later]
    first += [base for base in dict.fromkeys(map(base_of, later)) if base is not None and base not in first]
    # Some commands wait for a clock or for another page's port: one more than there are cores keeps these busy.
    with tempfile.TemporaryDirectory() as work, ThreadPoolExecutor((os.cpu_count() or 1) + 1) as pool:
        running: dict[Path, Future[Any]] = {}
        for page in [*first, *later]:  # a page that waits for its base has a thread that this one does not need
            running[page] = pool.submit(_run_behind, running.get(base_of(page) or page), page, Path(work), forks, now)
        for job in running.values():
            many, failed, reasons, said = job.result()
            count, faults, left_out = count + many, faults + failed, left_out + reasons
            if said:
                print(said, flush=True)
    print(f"documented commands and examples: {count} run, {faults} failed, {left_out.total()} not run")
    for reason, many in left_out.most_common():
        print(f"  {many} not run: {reason}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
