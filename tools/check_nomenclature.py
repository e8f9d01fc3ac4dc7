"""Check that docs/nomenclature.md explains every public physical quantity, and the pages on files every key and column.

Numbers that the pages of cell file and datasets state as defaults are held against the tables that read these files.

A public name is a parameter of a public function or method, or an annotated attribute of a public class, that holds
floating-point numbers (``float``, ``Float``, ``Float32``, tuples and sequences of ``float``). It passes when

- it is a frame name (``T_a_b``, ``R_a_b``, ``Ts_a_b``, ``Rs_a_b``, ``p_a_b``, ``w_x`` ...), whose first part stands in
  the page's table of frame names;
- or it ends with a unit suffix of the page's table of suffixes;
- or it stands in one of the page's tables of names itself.

Left out are compiled kernels, whose arguments are those of the functions that call them, and the inside of the G-code
interpreter, whose values are words of a program. What the page lists and the package does not use is a fault too, so
that the page cannot go stale. Words that the project no longer uses (``retired_words.toml`` beside this file) are
refused everywhere, with what to write; those that are fine in a sentence only as names in src/.

    python tools/check_nomenclature.py
"""

from __future__ import annotations

import ast
import gc
import re
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pydantic import BaseModel

from counterflex.app.proof.truth import truth_of
from counterflex.files import plan_file, summary_file
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.tables import CellTables
from counterflex.files.dataset.manifest import Manifest
from counterflex.files.scenario_file import Scenario
from counterflex.files.schema import PoseTable
from counterflex.twin.truth.file import to_dict

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "nomenclature.md"
CELL = ROOT / "examples" / "cells" / "kr300_d16_small.toml"
SOURCES = ROOT / "src" / "counterflex"

RETIRED = Path(__file__).with_name("retired_words.toml")
_BUILT = (ROOT / "docs" / "_build", ROOT / "docs" / "gallery")  # by `make docs-html`, from what is read
_INNER = re.compile(
    r"kernel|gcode/(read|write|sinumerik)/(?!reader|writer|arc_fit|arc_pieces|written_line|parameter_file)"
)
_NUMERIC = re.compile(r"\b(?:float|Float|Float32)\b")
_OTHER = re.compile(r"\b(?:str|dict|Mapping|Callable|Iterator|Arithmetic)\b")
_FRAME = re.compile(r"^(Ts|Rs|T|R|ps|p|w|C|J)_[a-z][a-z0-9]*(?:_[a-z0-9_]+)?$")
_CODE = re.compile(r"`([^`]+)`")


@dataclass(frozen=True)
class Quantity:
    """A public name that holds floating-point numbers, and where it stands."""

    name: str
    where: str


@dataclass
class Page:
    """The nomenclature page: unit suffixes, frame names, other names."""

    suffixes: set[str] = field(default_factory=set)
    frames: set[str] = field(default_factory=set)
    names: set[str] = field(default_factory=set)

    def explains(self, name: str) -> bool:
        """Return whether the page says unit and sign of a name."""
        return name in self.names or self._frame(name) is not None or self.suffix(name) is not None

    def _frame(self, name: str) -> str | None:
        match = _FRAME.match(name)
        return match[1] if match and match[1] in self.frames else None

    def suffix(self, name: str) -> str | None:
        """Longest suffix of the page that a name ends with."""
        found = [suffix for suffix in self.suffixes if name.endswith(suffix) and len(name) > len(suffix)]
        return max(found, key=len, default=None)

    def unused(self, names: set[str]) -> list[str]:
        """Names that the page lists and no public name uses."""
        suffixes = {self.suffix(name) for name in names}
        frames = {self._frame(name) for name in names}
        left = self.names - names
        left |= {suffix for suffix in self.suffixes if suffix not in suffixes}
        left |= {f"{frame}_" for frame in self.frames if frame not in frames}
        return sorted(left)


def read_page(text: str) -> Page:
    """Read the tables of the page: first column, code marks; one heading per kind of table."""
    page = Page()
    target: set[str] | None = None
    for line in text.splitlines():
        if line.startswith("## "):
            title = line.lower()
            target = page.suffixes if "suffix" in title else page.frames if "frame" in title else page.names
        elif line.startswith("|") and target is not None:
            for entry in _CODE.findall(line.split("|")[1]):
                target.add(entry.split("_")[0] if target is page.frames else entry)
    return page


def quantities(source: str, file: str) -> Iterator[Quantity]:
    """Public quantities of one module; its own names for kinds of numbers count as what they stand for."""
    body = ast.parse(source, file).body
    aliases = {
        node.targets[0].id
        for node in body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and _is_alias(node.value)
    }
    yield from _of(body, file, aliases)


def _is_alias(value: ast.expr) -> bool:
    """Return whether a module-level value is a type such as ``Annotated[float, ...]`` or ``tuple[float, ...]``."""
    return isinstance(value, ast.Subscript) and _numeric(value, set())


def _of(body: list[ast.stmt], file: str, aliases: set[str], owner: str = "") -> Iterator[Quantity]:
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from _of(node.body, file, aliases, f"{node.name}.")
        elif isinstance(node, ast.FunctionDef) and _is_public(node):
            arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
            for argument in arguments:
                if argument.annotation is not None and _numeric(argument.annotation, aliases):
                    yield Quantity(argument.arg, f"{file}:{node.lineno} {owner}{node.name}")
        elif (
            isinstance(node, ast.AnnAssign)
            and owner
            and isinstance(node.target, ast.Name)
            and not node.target.id.startswith("_")
            and _numeric(node.annotation, aliases)
        ):
            yield Quantity(node.target.id, f"{file}:{node.lineno} {owner.rstrip('.')}")


def _is_public(node: ast.FunctionDef) -> bool:
    kernel = any("kernel" in ast.unparse(decorator) for decorator in node.decorator_list)
    return not node.name.startswith("_") and not kernel


def _numeric(annotation: ast.expr, aliases: set[str]) -> bool:
    text = ast.unparse(annotation)
    named = {node.id for node in ast.walk(annotation) if isinstance(node, ast.Name)}
    return bool(_NUMERIC.search(text) or named & aliases) and not _OTHER.search(text)


def all_quantities() -> list[Quantity]:
    """Public quantities of the whole package."""
    found: list[Quantity] = []
    for path in sorted(SOURCES.rglob("*.py")):
        if not path.name.startswith("_") and not _INNER.search(path.relative_to(SOURCES).as_posix()):
            found += quantities(path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix())
    return found


def tables_of(model: type[BaseModel] = CellTables) -> list[type[BaseModel]]:
    """Every table of a file, as what reads it has them; of the cell file by default."""
    tables: list[type[BaseModel]] = []
    todo: list[object] = [model]
    while todo:
        item = todo.pop()
        if isinstance(item, type) and issubclass(item, BaseModel):
            tables += [] if item in tables else [item]
            todo += [info.annotation for info in item.model_fields.values()]
        else:
            todo += getattr(item, "__args__", ())
    return tables


def cell_keys(model: type[BaseModel] = CellTables) -> set[str]:
    """Every key of the cell file, as the tables that read it have them."""
    return {key for table in tables_of(model) for key in table.model_fields}


def defaults_of(model: type[BaseModel] = CellTables) -> dict[str, set[object]]:
    """Defaults by key, over all tables that have it."""
    results: dict[str, set[object]] = {}
    for table in tables_of(model):
        for key, info in table.model_fields.items():
            results.setdefault(key, set()).add(info.default if isinstance(info.default, int | float) else None)
    return results


def wrong_defaults(text: str, defaults: dict[str, set[object]]) -> list[str]:
    """Numbers in the last column of a page's tables that no table of the file has as default of the key."""
    faults = []
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split(" |")] if line.startswith("| `") else [""]
        keys = [key for entry in _CODE.findall(cells[0]) for key in entry.split()]
        values = [value.strip() for value in cells[-1].split(",")]
        for key, value in zip(keys, values if len(values) == len(keys) else values * len(keys), strict=False):
            known = defaults.get(key, {None})
            if re.fullmatch(r"-?\d+(\.\d+)?", value) and None not in known and float(value) not in known:
                faults.append(f"`{key}` is {', '.join(map(str, known))} where nothing is given, not {value}")
    return faults


def truth_keys(table: object) -> set[str]:
    """Every key of a table and of the tables in it."""
    if isinstance(table, dict):
        return set(table).union(*map(truth_keys, table.values()))
    return set().union(*map(truth_keys, table)) if isinstance(table, list) else set()


def file_keys() -> dict[str, set[str]]:
    """Keys and columns of every file format, by the page that explains them."""
    return {
        "cell-file.md": cell_keys(),
        "datasets.md": cell_keys(Manifest) - set(PoseTable.model_fields) - {"format", "version"},
        "plan-file.md": {column.name for column in plan_file.LAYOUT},
        "run-file.md": {column.name for column in summary_file.LAYOUT},
        "scenario-file.md": cell_keys(Scenario),
        "truth-file.md": truth_keys(to_dict(truth_of(read_cell(CELL), 1))),
    }


def file_defaults() -> dict[str, dict[str, set[object]]]:
    """Defaults of the files whose pages state them."""
    return {"cell-file.md": defaults_of(), "datasets.md": defaults_of(Manifest)}


def missing_keys(text: str, keys: set[str]) -> list[str]:
    """Keys that a page does not name in the first column of a table."""
    rows = "\n".join(line.split("|")[1] for line in text.splitlines() if line.startswith("|"))
    named = {key for entry in _CODE.findall(rows) for key in entry.split()}
    return sorted(keys - named)


def retired_words(text: str, where: str, words: dict[str, str]) -> list[str]:
    """Faults of the lines of a text that use a retired word.

    Args:
        text: Code or page.
        where: Its path, for the fault.
        words: What to write, by pattern.
    """
    # Without the first \b, which admits no less, the search skips to the first letter: four times as fast.
    there = {p: write for p, write in words.items() if re.search(p.removeprefix(r"\b"), text, re.MULTILINE)}
    return [
        f"{where}:{number}: '{found[0]}' is retired; write: {write}"
        for number, line in enumerate(text.splitlines() if there else (), 1)
        for pattern, write in there.items()
        if (found := re.search(pattern, line))
    ]


def retired_names(source: str, where: str, names: dict[str, str]) -> list[str]:
    """Faults of a module that calls something by a retired name.

    Args:
        source: Of the module.
        where: Its path, for the fault.
        names: What to write, by name without underscores around it, in small letters.
    """
    out: list[str] = []
    if names.keys().isdisjoint(word.strip("_") for word in re.findall(r"\w+", source.lower())):
        return out
    for node in ast.walk(ast.parse(source, where)):
        name = ""
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            name = node.name
        elif isinstance(node, ast.arg):
            name = node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            name = node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            name = node.attr
        key = name.strip("_").lower()
        if key in names:
            out.append(f"{where}:{getattr(node, 'lineno', 0)}: '{name}' is retired as a name; write: {names[key]}")
    return out


def texts() -> Iterator[Path]:
    """Everything that is read: code, messages, pages."""
    for folder in ("src", "lab", "tests", "tools", "benchmarks", "docs", "examples"):
        files = (p for p in (ROOT / folder).rglob("*") if p.suffix in (".py", ".md", ".html"))
        yield from sorted(p for p in files if not any(map(p.is_relative_to, _BUILT)))
    yield from (ROOT / "README.md", ROOT / "CONTRIBUTING.md")


def main() -> int:
    """Check all pages; print faults; 1 when there are any."""
    gc.disable()  # syntax trees hold no circles
    page = read_page(PAGE.read_text(encoding="utf-8"))
    found = all_quantities()
    faults = [
        f"{item.where}: '{item.name}' is not on docs/nomenclature.md" for item in found if not page.explains(item.name)
    ]
    faults += [f"docs/nomenclature.md: `{name}` is used nowhere" for name in page.unused({item.name for item in found})]
    count = 0
    for name, keys in file_keys().items():
        text = (ROOT / "docs" / name).read_text(encoding="utf-8")
        faults += [f"docs/{name}: `{key}` is missing in a first column" for key in missing_keys(text, keys)]
        faults += [f"docs/{name}: {fault}" for fault in wrong_defaults(text, file_defaults().get(name, {}))]
        count += len(keys)
    retired = tomllib.loads(RETIRED.read_text(encoding="utf-8"))
    words = {row["pattern"]: row["write"] for row in retired["word"]}
    for path in texts():
        text, where = path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix()
        faults += retired_words(text, where, words)
        if path.suffix == ".py" and path.is_relative_to(SOURCES):
            faults += retired_names(text, where, retired["names"])
    for fault in faults:
        print(fault)
    names = len({item.name for item in found})
    print(f"nomenclature: {names} names at {len(found)} places, {count} keys and columns, {len(faults)} faults")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
