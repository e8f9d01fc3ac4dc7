"""Files with random damage: either the job is done or one line says why not; never anything between."""

from __future__ import annotations

import random
import re
from pathlib import Path
from typing import Any

import pytest

VALUES = ["0", "-1", "1e9", "1e-9", "nan", "inf", "-inf", "0.5", "7", "1e300", "-45", "90", "180", "true", '"x"']


def _damaged(text: str, rng: random.Random) -> str:
    """One small change: characters lost, inserted or repeated, a line lost or swapped, a number replaced."""
    at = rng.randrange(len(text))
    end = min(len(text), at + rng.randrange(1, 12))
    lines = text.split("\n")
    one, two = rng.randrange(len(lines)), rng.randrange(len(lines))
    swapped = [*lines]
    swapped[one], swapped[two] = lines[two], lines[one]
    number = rng.choice(list(re.finditer(r"-?\d+\.?\d*", text)))
    return rng.choice(
        [
            text[:at] + text[end:],
            text[:at] + rng.choice('0123456789.-[]"=nXYZGM#o{}e \n') + text[at:],
            text[:at] + text[at:end] * 3 + text[end:],
            "\n".join(lines[:one] + lines[one + 1 :]),
            "\n".join(swapped),
            text[: number.start()] + rng.choice(VALUES) + text[number.end() :],
        ]
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "command"),
    [("cell.toml", ("cell", "check", "cell.toml")), ("part.ngc", ("path", "part.ngc", "--csv", "new/path.csv"))],
    ids=["cell", "program"],
)
@pytest.mark.parametrize("seed", range(6))
def test_damaged_file(folder: Path, counterflex: Any, name: str, command: tuple[str, ...], seed: int) -> None:
    rng = random.Random(seed)
    sound = (folder / name).read_text(encoding="utf-8")
    for _ in range(20):
        text = sound
        for _ in range(rng.randrange(1, 4)):
            text = _damaged(text, rng)
        (folder / name).write_text(text, encoding="utf-8")
        ended = counterflex(*command)
        assert ended.status in (0, 2), text
        if ended.status == 0:
            assert re.fullmatch(r"(warning: [^\n]+\n)*", ended.err), text  # a unit that is no longer said
            assert ended.out
        else:
            assert ended.out == ""
            assert re.fullmatch(r"error: [^\n]+\n", ended.err), text
            assert not (folder / "new").exists()
        (folder / "new" / "path.csv").unlink(missing_ok=True)
        if (folder / "new").exists():
            (folder / "new").rmdir()
