"""Every module that opens a socket or writes a file past `core/atomic.py` stands in the threat model, and no other."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = (ROOT / "src" / "counterflex", ROOT / "lab")
PAGE = (ROOT / "docs" / "threat-model.md").read_text(encoding="utf-8")
PORTS = ("Ports that listen", "Ports that only ask", "Simulated devices")
FILES = ("Files that are written",)
_SOCKETS = {
    "socket.socket", "socket.create_connection", "socket.create_server", "uvicorn.Config", "uvicorn.run",
    "http.server.HTTPServer", "http.server.ThreadingHTTPServer", "asyncio.start_server", "asyncio.open_connection",
    "Server", "BoundedServer", "LocalCluster",
}  # fmt: skip
_TEMPORARY = {"mkstemp", "mkdtemp", "TemporaryDirectory", "TemporaryFile", "NamedTemporaryFile", "SharedMemory"}
_WRITES = {"write_text", "write_bytes", "write_parquet", "write_csv", "savez", "savez_compressed", "touch", "copyfile"}
_WRITES |= {"copytree", "copy2", "symlink_to"}


def called(call: ast.Call) -> str:
    """Dotted name of what is called."""
    words, at = [], call.func
    while isinstance(at, ast.Attribute):
        words.append(at.attr)
        at = at.value
    return ".".join(reversed([*words, at.id] if isinstance(at, ast.Name) else words))


def opens_to_write(call: ast.Call) -> bool:
    given = [*call.args, *(word.value for word in call.keywords if word.arg == "mode")]
    modes = [one.value for one in given if isinstance(one, ast.Constant) and isinstance(one.value, str)]
    return any(re.fullmatch(r"[rwaxbt+]{1,3}", mode) and set(mode) & set("wax+") for mode in modes)


def has_port(source: str) -> bool:
    calls = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
    return any(called(call) in _SOCKETS for call in calls)


def writes(source: str) -> bool:
    """Whether a module writes other than through `core/atomic.py`."""
    whole = re.search(r"^from counterflex\.core(\.atomic import| import (\w+, )*atomic\b)", source, re.MULTILINE)
    for call in (node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)):
        name = called(call)
        last = name.rpartition(".")[2]
        if name == "os.open" or last in _TEMPORARY or (last == "open" and opens_to_write(call)):
            return True
        if last in _WRITES and whole is None:
            return True
    return False


def found(test: object) -> set[str]:
    files = {path.relative_to(base).as_posix(): path for base in SOURCES for path in base.rglob("*.py")}
    texts = {name: path.read_text(encoding="utf-8") for name, path in files.items()}
    return {name for name, text in texts.items() if test(text)}  # type: ignore[operator]


def named(*headings: str) -> set[str]:
    parts = re.split(r"^## ", PAGE, flags=re.MULTILINE)
    chosen = [part for part in parts if part.split("\n")[0] in headings]
    assert len(chosen) == len(headings)
    return {name for part in chosen for name in re.findall(r"`([a-z_0-9/]+\.py)`", part)}


def test_every_port_is_named_with_who_may_speak() -> None:
    assert found(has_port) == named(*PORTS), "name it in docs/threat-model.md, with who may speak there"


def test_every_writer_is_named_with_who_may_write() -> None:
    through = {"core/atomic.py", "app/written_out.py"}
    assert found(writes) | through == named(*FILES) | through, (
        "name it in docs/threat-model.md, with who may write there"
    )


@pytest.mark.parametrize(
    ("source", "port", "file"),
    [
        ("socket.socket(a, b).bind(c)", True, False),
        ("uvicorn.Config(app)", True, False),
        ("path.open('xb')", False, True),
        ("open(path, mode='a')", False, True),
        ("path.open('rb')", False, False),
        ("json.loads(text).open('r')", False, False),
        ("path.write_text(x)", False, True),
        ("from counterflex.core.atomic import atomic_path\npath.write_text(x)", False, False),
        ("from counterflex.core.atomic import atomic_path\nos.open(path, flags)", False, True),
        ("tempfile.mkdtemp()", False, True),
    ],
)
def test_the_walk_sees_what_opens_and_what_writes(source: str, port: bool, file: bool) -> None:
    assert (has_port(source), writes(source)) == (port, file)


def test_every_row_says_who() -> None:
    """No cell of a table is left empty where somebody may speak or write."""
    for heading in ("Ports that listen", *FILES):
        part = next(each for each in re.split(r"^## ", PAGE, flags=re.MULTILINE) if each.startswith(heading))
        rows = [line.strip("| \n").split(" | ") for line in part.splitlines() if line.startswith("| ")][1:]
        assert len(rows) > 6
        assert all(cell.strip() for row in rows for cell in row)
