"""A third of all that takes long, the next one at each commit: long tests, documented commands, benchmarks.

Each file belongs to one third, by its path alone. The thirds take turns with the commits. What the last commit changes
is run besides, and what has been changed since; unless that are so many files that the commit is about none of them.

    python tools/thirds.py
    python tools/thirds.py FILE    # status 0 where this commit runs the long tests of FILE
"""

from __future__ import annotations

import subprocess
import sys
import zlib
from collections.abc import Collection
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
COUNT: Final = 3
MOST_CHANGED: Final = 20
"""Changed files of tests, benchmarks and pages that are run besides, at most."""
_RUN: Final = ("tests", "benchmarks", "docs", "README.md")
_SALT: Final = "jv"
"""Of all pairs of letters it makes the thirds most alike in length."""


class Turn(NamedTuple):
    """Share of the long runs at one commit."""

    number: int  # of the third, from 0
    changed: Collection[str] = ()  # paths below the root of what is run besides
    why: str = ""  # what says the number

    def takes(self, path: str) -> bool:
        """Return whether a file is run.

        Args:
            path: Below the root, with slashes.
        """
        return third_of(path) == self.number or path in self.changed


def third_of(path: str) -> int:
    """Third that a file belongs to, 0 to 2.

    Args:
        path: Below the root, with slashes.
    """
    return zlib.crc32(f"{_SALT}{path}".encode()) % COUNT


def turn(root: Path = ROOT) -> Turn:
    """Turn of the commit that is checked out.

    A clone without history cannot count its commits: there the commit's name says the third, which is then drawn and
    takes no turns, and what the commit has changed is unknown.

    Args:
        root: Folder of the tree.
    """
    name, count = _git(root, "rev-parse", "HEAD"), _git(root, "rev-list", "--count", "HEAD")
    if not name:
        return Turn(0, why="Git is not at hand: always this one")
    if _git(root, "rev-parse", "--is-shallow-repository") == "true":
        return Turn(int(name, 16) % COUNT, why=f"commit {name[:8]} of a clone without history: drawn by its name")
    changed = _git(root, "diff", "--name-only", "--relative", "HEAD^", "--", *_RUN).splitlines()
    said = f"commit number {count} and its {len(changed)} changed files"
    if len(changed) > MOST_CHANGED:
        return Turn(int(count) % COUNT, why=f"{said}, too many to be run besides")
    return Turn(int(count) % COUNT, frozenset(changed), said)


def _git(root: Path, *words: str) -> str:
    """Answer of Git, empty where it cannot."""
    try:
        ended = subprocess.run(["git", *words], cwd=root, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return ""
    return ended.stdout.strip() if ended.returncode == 0 else ""


def said(now: Turn) -> str:
    """The runs of a turn as a line."""
    return f"third {now.number + 1} of {COUNT} of long tests, documented commands, benchmarks ({now.why})"


if __name__ == "__main__":
    print(said(turn()))
    sys.exit(any(not turn().takes(path) for path in sys.argv[1:]))
