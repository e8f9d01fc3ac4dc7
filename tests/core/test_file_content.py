"""Reading files in one place: faults of the system and of libraries, and that no reader goes past it."""

from __future__ import annotations

import ast
import errno
import os
from pathlib import Path
from typing import Final

import polars as pl
import pytest

from counterflex.core.errors import FileFormatError, InputError, ProgramError
from counterflex.core.file_content import content, json_value, readable, text

ROOT: Final = Path(__file__).parents[2] / "src" / "counterflex"
READS: Final = {
    "read_bytes", "read_text", "read_parquet", "read_parquet_metadata", "read_parquet_schema", "read_csv",
    "scan_parquet", "load_mesh",
}  # fmt: skip
LOADS: Final = {"np", "json", "trimesh", "pickle"}
OWN: Final = {
    "core/file_content.py": "the place itself",
    "programs/source_text.py": "has a read_text that stands on the place",
    "core/build_data.py": "commit of this installation",
    "core/held.py": "boot id of this computer",
    "core/jit.py": "cache of compiled kernels",
    "core/shipped.py": "comes with the package; by its SHA-256, or not read",
    "core/output_place.py": "processes of this computer; its own temporary file",
    "app/benchmark_part/part.py": "comes with the package",
    "app/examples.py": "comes with the package",
    "app/long_jobs/step_cache.py": "code of the package; a step that cannot be read is done again",
    "app/warm.py": "sources of the package",
    "app/run_history/logged_run.py": "looks whether a file is there; one that cannot be read is none",
    "cutting/material.py": "comes with the package or another one",
    "files/scenario_file.py": "comes with the package",
    "files/logs/segments.py": "salvages what can be read",
    "files/scan/read.py": "within its block",
    "files/scan/number_lines.py": "within the block of files/scan/read.py",
    "files/scan/ply.py": "within the block of files/scan/read.py",
    "files/scan/table.py": "within the block of files/scan/read.py",
    "protocols/processes/instance_lock.py": "written by another process of this program",
    "protocols/processes/one_run.py": "written by another process of this program",
    "protocols/processes/operator_words.py": "written by another process of this program",
    "protocols/system/machine.py": "the system of this computer",
    "protocols/system/realtime.py": "the system of this computer",
    "robot/model/catalog.py": "comes with the package",
    "robot/model/class_prior.py": "comes with the package",
    "app/add_ins.py": "comes with the package",
    "app/prediction_interval.py": "comes with the package",
    "app/language_trial.py": "what the trial has just written",
    "integrations/freecad/counterflex_post.py": "runs in FreeCAD, on what it and counterflex have just written",
}
"""Modules that read by themselves, with the reason."""


def _name(call: ast.Call) -> tuple[str, str]:
    function = call.func
    if isinstance(function, ast.Attribute):
        return function.attr, function.value.id if isinstance(function.value, ast.Name) else ""
    return (function.id, "") if isinstance(function, ast.Name) else ("", "")


def _reads(call: ast.Call) -> bool:
    name, of = _name(call)
    if name == "open" and of not in ("os", "webbrowser", "kind") and isinstance(call.func, ast.Attribute):
        given = [*call.args, *(word.value for word in call.keywords if word.arg == "mode")]
        modes = [one.value for one in given if isinstance(one, ast.Constant) and isinstance(one.value, str)]
        return bool(modes) and "r" in modes[0] and "+" not in modes[0]
    return (name in READS and isinstance(call.func, ast.Attribute)) or (name == "load" and of in LOADS)


def _past(node: ast.AST, inside: bool) -> list[int]:
    """Lines of calls that read outside a block of ``readable``."""
    if isinstance(node, ast.With):
        calls = [item.context_expr for item in node.items if isinstance(item.context_expr, ast.Call)]
        inside = inside or any(_name(call)[0] == "readable" for call in calls)
    found = [node.lineno] if isinstance(node, ast.Call) and not inside and _reads(node) else []
    return found + [line for child in ast.iter_child_nodes(node) for line in _past(child, inside)]


def test_no_reader_goes_past_the_place() -> None:
    past = {}
    for file in sorted(ROOT.rglob("*.py")):
        name = file.relative_to(ROOT).as_posix()
        lines = _past(ast.parse(file.read_text(encoding="utf-8")), False)
        if lines:
            past[name] = lines
    past.pop("integrations/kuka/simulated.py", None)  # a telegram, no file
    assert {name: lines for name, lines in past.items() if name not in OWN} == {}


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        (FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), "a.toml"), "no such file"),
        (IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR)), "it is a folder"),
        (PermissionError(errno.EACCES, os.strerror(errno.EACCES)), "cannot be read: Permission denied"),
        (OSError(errno.EIO, os.strerror(errno.EIO)), "cannot be read: Input/output error"),
        (pl.exceptions.ComputeError("Permission denied (os error 13)"), "cannot be read: Permission denied"),
        (pl.exceptions.ComputeError("parquet: File out of specification"), "not readable as a table; got parquet"),
        (RecursionError("maximum recursion depth"), "not readable as a table; got nested too deeply"),
        (MemoryError(), "more than the memory of this computer"),
        (ValueError("Exceeds the limit (4300 digits)"), "got Exceeds the limit"),
        (EOFError(), "not readable as a table; got EOFError"),
        (KeyError("columns"), "not readable as a table"),
    ],
)
def test_what_a_library_raises_is_one_error(fault: BaseException, says: str) -> None:
    with pytest.raises(FileFormatError) as told, readable("folder/a.toml", "a table", family=ProgramError):
        raise fault
    assert isinstance(told.value, ProgramError)
    assert str(told.value).startswith("folder/a.toml: ")
    assert says in str(told.value)
    assert told.value.hint


def test_what_is_no_fault_of_the_file_passes() -> None:
    for passed in (KeyboardInterrupt(), SystemExit(3), InputError("another fault")):
        with pytest.raises(type(passed)) as told, readable("a.toml", "a table"):
            raise passed
        assert told.value is passed


def test_text_and_json(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_bytes('\ufeff{"ä": [1, null]}'.encode())
    assert json_value(file) == {"ä": [1, None]}
    file.write_bytes(b"a\nb\xe4\n")
    with pytest.raises(FileFormatError, match="byte 0xe4 in line 2"):
        text(file)
    file.write_bytes(b"a\nb\n\0")
    with pytest.raises(FileFormatError, match=r"a\.json:3: not a text file: it contains zero bytes"):
        text(file)
    file.write_bytes("a".encode("utf-16"))
    with pytest.raises(FileFormatError, match="text in UTF-16"):
        text(file)
    with pytest.raises(FileFormatError, match="it is a folder"):
        content(tmp_path)
    with pytest.raises(FileFormatError, match="no such file"):
        content(tmp_path / "b.json")
