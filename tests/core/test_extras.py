"""Extras: a library is imported where its extra lies, nothing else needs it, one line says what to install."""

from __future__ import annotations

import ast
import importlib.util
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import pytest

import counterflex
from counterflex.app.log_export.job import require_rerun
from counterflex.app.opcua import settings as opcua
from counterflex.app.panel import settings as panel
from counterflex.core.errors import CounterflexError
from counterflex.files.certificate.document import require_library
from counterflex.files.dataset import instrument_files
from counterflex.files.scan import by_library
from counterflex.integrations.beckhoff.link import link as ads
from counterflex.robot.model import urdf

ROOT: Final = Path(counterflex.__file__).parent
PLACES: Final[dict[str, str | tuple[str, ...]]] = {
    "nicegui": ("app/panel/", "app/studio/"),
    "fastapi": "app/panel/",
    "starlette": ("app/panel/", "app/studio/"),
    "uvicorn": "app/panel/",
    "asyncua": "app/opcua/",
    "rerun": "app/log_export/job.py",
    "xmlschema": "files/certificate/document.py",
    "nptdms": "files/dataset/instrument_files.py",
    "pye57": "files/scan/by_library.py",
    "laspy": "files/scan/by_library.py",
    "pypcd4": "files/scan/by_library.py",
    "pyads": "integrations/beckhoff/link/link.py",
    "yourdfpy": "robot/model/urdf.py",
}
"""Libraries of extras, and the folder or module that imports them, by ``import`` or by name."""
WITHOUT: Final = """
import importlib, pkgutil, sys
for name in {names!r}:
    sys.modules[name] = None
import counterflex
failed = []
for item in pkgutil.walk_packages(counterflex.__path__, "counterflex.", onerror=lambda _: None):
    if item.name.endswith("__main__"):
        continue
    try:
        importlib.import_module(item.name)
    except ImportError as fault:
        failed.append(item.name)
print(*failed)
"""


def _named(tree: ast.AST) -> set[str]:
    """Libraries that a module imports anywhere, also by a text that is their name."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {one.name.partition(".")[0] for one in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found.add((node.module or "").partition(".")[0])
        elif isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in (
            "import_module",
            "needed",
        ):
            found |= {one.value for one in node.args if isinstance(one, ast.Constant) and isinstance(one.value, str)}
    return found & set(PLACES)


def test_the_library_of_an_extra_is_imported_where_the_extra_lies() -> None:
    wrong, used = [], set()
    for file in sorted(ROOT.rglob("*.py")):
        name = file.relative_to(ROOT).as_posix()
        text = file.read_text(encoding="utf-8")
        found = _named(ast.parse(text)) if any(library in text for library in PLACES) else set()
        wrong += [f"{name}: {library}" for library in sorted(found) if not name.startswith(PLACES[library])]
        used |= found
    assert wrong == []
    assert used == set(PLACES)


def test_without_any_extra_all_but_the_servers_can_be_imported() -> None:
    """In a process in which no library of an extra can be imported."""
    script = WITHOUT.format(names=list(PLACES))
    ended = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    servers = ("opcua.bounded", "opcua.nodes", "opcua.server", "panel.gated_server", "panel.page", "panel.server")
    pages = (
        *("cell_page", "desk", "file_mapping", "identified_card", "inspect_page", "measure_page", "plan_page"),
        *("program_page", "server", "shell"),
    )
    assert set(ended.stdout.split()) == {
        f"counterflex.app.{name}" for name in (*servers, *(f"studio.{one}" for one in pages))
    }


def _tdms(file: Path) -> None:
    instrument_files.InstrumentColumns.of_tdms(file, b"", None)


@pytest.mark.parametrize(
    ("extra", "library", "use"),
    [
        ("panel", "nicegui", lambda file: panel.require_safe(panel.PanelSettings(file.parent))),
        ("opcua", "asyncua", lambda file: opcua.OpcuaSettings(file.parent).require_safe()),
        ("rerun", "rerun", lambda _: require_rerun()),
        ("dcc", "xmlschema", lambda _: require_library()),
        ("formats", "nptdms", _tdms),
        ("formats", "pye57", by_library.read_e57),
        ("formats", "laspy", by_library.read_las),
        ("formats", "pypcd4", by_library.read_pcd),
        ("ads", "pyads", lambda _: ads._pyads()),
        ("urdf", "yourdfpy", lambda file: urdf._parse(file)),
    ],
)
def test_one_line_says_which_extra_is_missing(
    extra: str, library: str, use: Callable[[Path], Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "some.file"
    file.write_bytes(b"VERSION 0.7\nFIELDS x y z\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n0 0 0\n")
    monkeypatch.setitem(sys.modules, library, None)
    assert importlib.util.find_spec(library) is None
    with pytest.raises(CounterflexError) as told:
        use(file)
    said = str(told.value)
    assert f"counterflex[{extra}]" in said
    assert "\n" not in said
