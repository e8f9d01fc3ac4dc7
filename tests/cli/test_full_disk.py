"""A disk that takes no more, in every family of commands that write: one line, status 2, nothing half-written."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

resource = pytest.importorskip("resource", reason="limits of file sizes are those of POSIX")

FAMILIES = {
    "cell example": "cell example --out new/cell.toml",
    "path": "path part.ngc --csv new/path.csv",
    "compensate": "compensate part.ngc --cell cell.toml --out new --no-predict",
    "compensate, no page": "compensate part.ngc --cell cell.toml --out new --no-predict --no-report",
    "convert": "convert part.ngc --cell cell.toml --to krl --out new",
    "preflight": "preflight part.ngc --cell cell.toml --out new",
    "truth": "truth cell.toml --seed 1 --out new/truth.toml",
    "simulate": "simulate part.ngc --cell cell.toml --truth truth.toml --out new",
    "evaluate": "evaluate run --out new",
    "mesh": "mesh run --out new/part.stl",
    "identify --propose": "identify payload --propose 12 --cell cell.toml --out new",
    "plan posture": "plan posture part.ngc --cell cell.toml --out new",
    "benchmark part": "benchmark-part write --out new",
    "dataset": "twin measure proposal/proposal.toml --cell cell.toml --truth truth.toml --out new",
}
_LIMITED = (
    "import resource, sys; from counterflex.cli.start import run; "
    "resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv.pop(1)),) * 2); run()"
)


def contents(folder: Path) -> dict[str, bytes | None]:
    """Every file and folder below a folder, hidden ones too, with what the files hold."""
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None for p in sorted(folder.rglob("*"))}


@pytest.fixture(scope="module")
def given(machined: object, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the commands read."""
    folder = tmp_path_factory.mktemp("given") / "work"
    shutil.copytree(machined.folder, folder)  # type: ignore[attr-defined]
    words = ["identify", "payload", "--propose", "12", "--cell", "cell.toml", "--out", "proposal"]
    program = [sys.executable, "-c", "from counterflex.cli.start import run; run()", *words]
    subprocess.run(program, cwd=folder, check=True, capture_output=True)
    return folder


@pytest.mark.long
@pytest.mark.parametrize("words", FAMILIES.values(), ids=FAMILIES.keys())
def test_one_line_and_nothing_is_left(given: Path, words: str) -> None:
    before = contents(given)
    # No file may grow beyond this: as a full disk, but for the number of the fault (27 for 28).
    program = [sys.executable, "-c", _LIMITED, "64", *words.split()]
    ended = subprocess.run(program, cwd=given, capture_output=True, check=False, text=True)
    assert ended.returncode == 2, ended.stdout + ended.stderr
    last = ended.stderr.strip().splitlines()[-1]
    assert last.startswith("error: "), ended.stderr
    assert "cannot write: File too large" in last
    assert "Traceback" not in ended.stderr
    assert ".part" not in last
    assert contents(given) == before
