"""Every place of the program that writes a file goes through the one mechanism that keeps links and devices."""

from __future__ import annotations

import ast
from pathlib import Path

import counterflex
import counterflex_lab

ROOT = Path(counterflex.__file__).parent
LAB = Path(counterflex_lab.__file__).parents[1]
WRITES = {
    "write_text",
    "write_bytes",
    "write_csv",
    "write_parquet",
    "write_html",
    "write_json",
    "savez",
    "savez_compressed",
    "savetxt",
    "tofile",
    "to_csv",
    "copy",
    "copy2",
    "copyfile",
    "copytree",
}
BY_LIBRARY = {"write_csv", "write_parquet", "write_ipc", "write_json", "write_html", "export"}
"""Writers of libraries that do not raise OSError where the disk is full: they write into memory (atomic.write_made)."""
FILES = {
    "core/atomic.py": "the mechanism",
    "core/moving.py": "the mechanism",
    "core/output_place.py": "the mechanism",
    "app/language_trial.py": "in a temporary folder",
    "core/compiled.py": "a lock beside compiled kernels, in the user's cache",
    "integrations/freecad/counterflex_post.py": "runs in FreeCAD: the job in a temporary folder, copies of a program",
    "files/logs/run_log.py": "new names in a folder, segment by segment",
    "files/logs/repair.py": "keeps the original under a new name",
    "protocols/processes/instance_lock.py": "a lock, in the user's cache",
    "counterflex_lab/faults/files.py": "in a temporary folder",
    "counterflex_lab/faults/process_rig.py": "in a temporary folder",
    "counterflex_lab/faults/run_rig.py": "in a temporary folder",
    "counterflex_lab/soak/replayed_cell.py": "in a temporary folder",
    "counterflex_lab/soak/soak.py": "in a staging folder",
    "app/correction/correct.py": "in a staging folder",
    "app/identification/history.py": "in a staging folder",
    "app/studio/desk.py": "a file that arrives, under a name that is free, taken away where it does not arrive whole",
    "app/studio/jobs.py": "a list of commands that grows, line by line",
    "files/cell/update.py": "a trial in a staging folder",
}


def _mode(call: ast.Call) -> str:
    given = [*call.args, *(word.value for word in call.keywords if word.arg == "mode")]
    texts = [item.value for item in given if isinstance(item, ast.Constant) and isinstance(item.value, str)]
    return "".join(text for text in texts if len(text) <= 3)


def _writes(call: ast.Call) -> str:
    if not isinstance(call.func, ast.Attribute):
        return "open" if getattr(call.func, "id", "") == "open" and set(_mode(call)) & set("wax+") else ""
    name, owner = call.func.attr, getattr(call.func.value, "id", "")
    if name == "open" and set(_mode(call)) & set("wax+"):
        return name
    prints = name in ("write_csv", "write_json") and not call.args  # gives the text
    arrays = name == "copy" and not call.args
    return name if name in WRITES and owner not in ("atomic", "copy", "np") and not prints and not arrays else ""


def _temporary(tree: ast.AST) -> set[str]:
    """Names that stand for a temporary path of the mechanism, and streams opened there."""
    names: set[str] = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.With):
            continue
        for item in node.items:
            if isinstance(item.context_expr, ast.Call) and isinstance(item.optional_vars, ast.Name):
                text = ast.unparse(item.context_expr)
                if "atomic_path(" in text or any(f"{name}.open(" in text for name in names):
                    names.add(item.optional_vars.id)
    return names


def _in_memory(tree: ast.AST) -> set[int]:
    """Calls that are handed to :func:`counterflex.core.atomic.write_made`."""
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    named = [node for node in calls if getattr(node.func, "attr", "") == "write_made"]
    made = [node for node in named if ast.unparse(node.func) == "atomic.write_made"]
    return {id(part) for node in made for part in ast.walk(node)}


def test_nothing_is_written_beside_the_mechanism() -> None:
    found = []
    files = [(file.relative_to(base).as_posix(), file) for base in (ROOT, LAB) for file in sorted(base.rglob("*.py"))]
    for name, file in files:
        if name in FILES:
            continue
        tree = ast.parse(file.read_text(encoding="utf-8"))
        temporary, in_memory = _temporary(tree), _in_memory(tree)
        for node in ast.walk(tree):
            if not isinstance(node, ast.Call) or not (what := _writes(node)) or id(node) in in_memory:
                continue
            said = {part.id for part in ast.walk(node) if isinstance(part, ast.Name)}
            if what in BY_LIBRARY:
                found.append(f"{name}:{node.lineno}: {what}: the library's own fault at a full disk names no disk")
            elif not said & temporary:
                found.append(f"{name}:{node.lineno}: {what}")
    assert found == []


def test_the_exceptions_are_there() -> None:
    assert [name for name in FILES if not (ROOT / name).is_file() and not (LAB / name).is_file()] == []
