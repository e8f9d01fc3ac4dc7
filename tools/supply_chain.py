"""Check the licences of all locked packages; write the bill of materials of the wheel and docs/licences.md.

Usage: python tools/supply_chain.py [--check]. With --check nothing is written; exit 1 if a licence is not allowed, not
listed or not the one that its package states, or if a file is out of date.
"""

from __future__ import annotations

import importlib.metadata
import json
import re
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

ROOT: Final = Path(__file__).resolve().parents[1]
TABLE: Final = ROOT / "requirements" / "licences.toml"
BILL: Final = ROOT / "requirements" / "counterflex.cdx.json"
PAGE: Final = ROOT / "docs" / "licences.md"
BEGIN, END = "<!-- packages: written by tools/supply_chain.py -->\n", "<!-- end of packages -->\n"
_PIN = re.compile(r"^([A-Za-z0-9._-]+)==([^ \\;]+)(?: ; ([^\\]+?))? \\$", re.MULTILINE)
_HASH = re.compile(r"--hash=sha256:([0-9a-f]{64})")
_MARKS: Final = {
    "Apache-2.0": "apache license",
    "BSD-2-Clause": "redistribution and use in source and binary forms",
    "BSD-3-Clause": "redistribution and use in source and binary forms",
    "ISC": "permission to use, copy, modify, and",
    "LGPL-3.0-or-later": "gnu lesser general public license",
    "MIT": "permission is hereby granted, free of charge",
    "MPL-2.0": "mozilla public license",
    "PSF-2.0": "python software foundation license",
    "Qhull": "qhull",
}
"""Words by which a licence file is known."""


@dataclass(frozen=True)
class Package:
    """A locked package."""

    name: str  # as the lock file spells it
    version: str  # locked
    marker: str  # platforms that it is for; empty: all
    hashes: tuple[str, ...]  # SHA-256 of every file that may be installed


Locked: TypeAlias = dict[str, list[Package]]
"""By name; more than one version where platforms or Pythons need different ones."""


def locked(*texts: str) -> Locked:
    """Return the packages of lock files."""
    out: dict[tuple[str, str], Package] = {}
    for text in texts:
        out |= _locked(text)
    names: Locked = {}
    for (name, _), package in sorted(out.items()):
        names.setdefault(name, []).append(package)
    return names


def _locked(text: str) -> dict[tuple[str, str], Package]:
    found = list(_PIN.finditer(text))
    out = {}
    for k, match in enumerate(found):
        end = found[k + 1].start() if k + 1 < len(found) else len(text)
        hashes = tuple(sorted(_HASH.findall(text[match.end() : end])))
        name = _normal(match[1])
        out[name, match[2]] = Package(name, match[2], (match[3] or "").strip(), hashes)
    return out


def parts(expression: str) -> list[str]:
    """Return the licences of an expression; of a choice all must be allowed."""
    return [part.strip("() ") for part in re.split(r"\s+(?:AND|OR)\s+", expression)]


def faults(table: dict[str, Any], packages: Locked) -> list[str]:
    """Return what is wrong with the table, one line each."""
    listed, allowed, only = table["packages"], set(table["allowed"]["licences"]), table["allowed"]["only"]
    out = [f"{name}: locked, but not in {TABLE.name}" for name in packages if name not in listed]
    out += [f"{name}: in {TABLE.name}, but not locked" for name in listed if name not in packages]
    for name, row in listed.items():
        bad = [part for part in parts(row["licence"]) if part not in allowed]
        if bad and not only.get(name, "").startswith(f"{row['licence']}: "):
            out.append(f"{name}: {row['licence']} is not allowed")
        if name in only and row["of"] in ("run", "build"):
            out.append(f"{name}: {row['licence']} is allowed in an extra only, and is installed by default")
        out += _differs(name, row)
    return out


def _differs(name: str, row: dict[str, str]) -> list[str]:
    """Return what the installed package says otherwise."""
    try:
        package = importlib.metadata.distribution(name)
    except importlib.metadata.PackageNotFoundError:
        return [] if row["from"] == "absent" else [f"{name}: not installed, so its licence cannot be checked"]
    said = package.metadata
    (stated,) = said.get_all("License-Expression") or [None]
    if row["from"] == "metadata" or stated:
        same = stated == row["licence"] and row["from"] == "metadata"
        return [] if same else [f"{name}: states {stated}, listed as {row['licence']} from {row['from']}"]
    if row["from"] == "file":
        files = [file for file in package.files or [] if re.search(r"licen[cs]e|copying", str(file), re.IGNORECASE)]
        texts = [Path(str(file.locate())).read_text(errors="replace") for file in files if file.suffix != ".py"]
        marks = [_MARKS.get(part) for part in parts(row["licence"])]
        found = all(
            mark is not None and any(mark in " ".join(text.split()).lower() for text in texts) for mark in marks
        )
        return [] if found else [f"{name}: no licence file reads as {row['licence']}"]
    old = said.get_all("License") or [line for line in said.get_all("Classifier") or [] if line.startswith("License")]
    return [] if old else [f"{name}: states no licence, listed as {row['licence']} from {row['from']}"]


def bill(table: dict[str, Any], packages: Locked, project: dict[str, Any], version: str) -> dict[str, Any]:
    """Return the bill of materials, CycloneDX 1.6: what is installed, by default or with an extra."""
    listed = {name: row for name, row in sorted(table["packages"].items()) if row["of"] not in ("build", "dev")}
    extras = project["optional-dependencies"]
    asked = [*project["dependencies"], *(line for lines in extras.values() for line in lines)]
    direct = sorted({_normal(re.split(r"[\s<>=!~;\[]", line, maxsplit=1)[0]) for line in asked} & set(listed))
    own = f"pkg:pypi/{project['name']}@{version}"
    return {
        "$schema": "http://cyclonedx.org/schema/bom-1.6.schema.json",
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": own,
                "name": project["name"],
                "version": version,
                "purl": own,
                "licenses": [{"expression": project["license"]}],
            }
        },
        "components": [_component(package, row) for name, row in listed.items() for package in packages[name]],
        "dependencies": [{"ref": own, "dependsOn": [_purl(each) for name in direct for each in packages[name]]}],
    }


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _purl(package: Package) -> str:
    return f"pkg:pypi/{package.name}@{package.version}"


def _component(package: Package, row: dict[str, str]) -> dict[str, Any]:
    properties = {"counterflex:of": row["of"], "counterflex:licence-from": row["from"]}
    properties |= {"counterflex:marker": package.marker} if package.marker else {}
    properties |= {"counterflex:locked-sha256": " ".join(package.hashes)}
    return {
        "type": "library",
        "bom-ref": _purl(package),
        "name": package.name,
        "version": package.version,
        "scope": "required" if row["of"] == "run" else "optional",
        "licenses": [{"expression": row["licence"]}],
        "purl": _purl(package),
        "properties": [{"name": name, "value": value} for name, value in properties.items()],
    }


def page(text: str, table: dict[str, Any], packages: Locked) -> str:
    """Return the page with its table written anew."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    rows = ["| package | version | licence | of | read from |", "|---|---|---|---|---|"]
    for name, row in sorted(table["packages"].items(), key=lambda item: (item[1]["of"] in ("build", "dev"), item[0])):
        versions = ", ".join(package.version for package in packages[name])
        rows.append(f"| {name} | {versions} | {row['licence']} | {row['of']} | {row['from']} |")
    return before + BEGIN + "\n" + "\n".join(rows) + "\n\n" + END + after


def written() -> tuple[list[str], dict[Path, str]]:
    """Return what is wrong, and each file's text as it should be; no text where a package is not listed."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    packages = locked(*((ROOT / "requirements" / name).read_text(encoding="utf-8") for name in ("dev.txt", "run.txt")))
    wrong = faults(table, packages)
    if set(packages) != set(table["packages"]):
        return wrong, {}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    source = (ROOT / "src" / "counterflex" / "__init__.py").read_text(encoding="utf-8")
    version = re.search(r'^__version__ = "([^"]+)"', source, re.MULTILINE)
    assert version is not None
    made = json.dumps(bill(table, packages, project, version[1]), indent=1, ensure_ascii=False) + "\n"
    return wrong, {BILL: made, PAGE: page(PAGE.read_text(encoding="utf-8"), table, packages)}


def main() -> int:
    """Check, and write where that is asked for."""
    wrong, files = written()
    for path, text in files.items():
        if "--check" not in sys.argv:
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            wrong.append(f"{path.relative_to(ROOT)} is out of date: python tools/supply_chain.py")
    print("\n".join(wrong) if wrong else "licences: all listed, allowed and as stated")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
