"""The bill of materials is what the lock files say, in its published form; licences are listed and as stated."""

from __future__ import annotations

import copy
import importlib.util
import json
import re
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from jsonschema import Draft7Validator
from packaging.requirements import Requirement
from referencing import Registry, Resource

ROOT = Path(__file__).resolve().parents[2]
SCHEMAS = ROOT / "tests" / "data" / "cyclonedx"


def load() -> ModuleType:
    path = ROOT / "tools" / "supply_chain.py"
    spec = importlib.util.spec_from_file_location("supply_chain_tool", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["supply_chain_tool"] = module
    spec.loader.exec_module(module)
    return module


TOOL = load()
TABLE: dict[str, Any] = tomllib.loads(TOOL.TABLE.read_text(encoding="utf-8"))
LOCKED = TOOL.locked(*((ROOT / "requirements" / name).read_text(encoding="utf-8") for name in ("dev.txt", "run.txt")))
BILL: dict[str, Any] = json.loads(TOOL.BILL.read_text(encoding="utf-8"))


def validator() -> Draft7Validator:
    """The schema as CycloneDX publishes it, with those that it refers to; the validator is another project's."""
    main, *others = (
        json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))
        for name in ("bom-1.6", "spdx", "jsf-0.82")
    )
    named = [("spdx.SNAPSHOT.schema.json", others[0]), ("jsf-0.82.SNAPSHOT.schema.json", others[1])]
    base = main["$id"].rpartition("/")[0]
    registry: Registry[Any] = Registry().with_resources(
        [(f"{base}/{name}", Resource.from_contents(schema)) for name, schema in named]
    )
    return Draft7Validator(main, registry=registry)


def test_files_are_up_to_date_and_licences_are_as_stated() -> None:
    wrong, files = TOOL.written()
    assert not wrong
    for path, text in files.items():
        assert path.read_text(encoding="utf-8") == text, path


def test_the_bill_has_the_published_form() -> None:
    judge = validator()
    assert not list(judge.iter_errors(BILL))
    spoils: tuple[Callable[[dict[str, Any]], object], ...] = (
        lambda bill: bill["components"][0].pop("name"),
        lambda bill: bill["components"][0].update(scope="perhaps"),
        lambda bill: bill["components"].append(bill["components"][0]),
        lambda bill: bill.update(specVersion=1.6),
        lambda bill: bill.update(unknown=1),
        lambda bill: bill["components"][0]["licenses"].append({"license": {"id": "BSD"}}),
    )
    for spoil in spoils:
        spoilt = copy.deepcopy(BILL)
        spoil(spoilt)
        assert list(judge.iter_errors(spoilt))


def test_the_bill_names_what_the_lock_files_install_with_every_hash() -> None:
    """Counted in the lock files by other means: lines and hashes."""
    text = (ROOT / "requirements" / "run.txt").read_text(encoding="utf-8")
    lines = re.findall(r"^(\S+)==(\S+)", text, re.MULTILINE)
    tools = {name for name, row in TABLE["packages"].items() if row["of"] == "build"}
    required = {(one["name"], one["version"]) for one in BILL["components"] if one["scope"] == "required"}
    assert required == {(name, version) for name, version in lines if name not in tools}
    hashes = {name: 0 for name, _ in lines}
    for block in re.split(r"\n(?=\S)", text):
        hashes[block.split("==")[0]] += block.count("--hash=sha256:")
    for one in BILL["components"]:
        if one["scope"] == "required":
            said = {each["name"]: each["value"] for each in one["properties"]}
            versions = sum(name == one["name"] for name, _ in lines)
            assert versions > 1 or len(said["counterflex:locked-sha256"].split()) == hashes[one["name"]]
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    direct = {Requirement(line).name.lower() for line in project["dependencies"]}
    assert direct <= {ref.split("/")[1].split("@")[0] for ref in BILL["dependencies"][0]["dependsOn"]}
    refs = [one["bom-ref"] for one in BILL["components"]]
    assert len(refs) == len(set(refs))
    assert set(BILL["dependencies"][0]["dependsOn"]) <= set(refs)


def test_two_versions_of_a_package_are_two_components() -> None:
    """SciPy of another Python was left out of a list that kept the last version of a name."""
    rows = {"1.17.1 ; python_full_version < '3.12'": "a", "1.18.1 ; python_full_version >= '3.12'": "bc"}
    text = ""
    for row, letters in rows.items():
        text += f"scipy=={row} \\\n" + " \\\n".join(f"    --hash=sha256:{letter * 64}" for letter in letters) + "\n"
    found = TOOL.locked(text)["scipy"]
    assert [(one.version, one.marker, len(one.hashes)) for one in found] == [
        ("1.17.1", "python_full_version < '3.12'", 1),
        ("1.18.1", "python_full_version >= '3.12'", 2),
    ]


@pytest.mark.parametrize(
    ("name", "row", "said"),
    [
        ("numpy", {"licence": "GPL-3.0-only"}, "not allowed"),
        ("asyncua", {"of": "run"}, "allowed in an extra only"),
        ("asyncua", {"licence": "LGPL-2.1-only"}, "not allowed"),
        ("pydantic", {"licence": "Apache-2.0"}, "states MIT, listed as Apache-2.0"),
        ("rich", {"licence": "ISC"}, "no licence file reads as ISC"),
        ("py-opw-kinematics", {"from": "stated"}, "states no licence"),
        ("colorama", {"from": "file"}, "cannot be checked"),
    ],
)
def test_a_wrong_row_is_named(name: str, row: dict[str, str], said: str) -> None:
    table = copy.deepcopy(TABLE)
    table["packages"][name].update(row)
    (fault,) = [line for line in TOOL.faults(table, LOCKED) if line.startswith(f"{name}: ") and said in line]
    assert name in fault


def test_a_package_that_is_locked_or_listed_alone_is_named() -> None:
    table = copy.deepcopy(TABLE)
    table["packages"].pop("numpy")
    table["packages"]["left-over"] = {"licence": "MIT", "of": "run", "from": "absent"}
    assert {line.split(":")[0] for line in TOOL.faults(table, LOCKED)} == {"numpy", "left-over"}


def test_what_is_said_to_be_of_an_extra_is_not_asked_for_by_the_package_itself() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for line in project["dependencies"]:
        assert TABLE["packages"][Requirement(line).name.lower()]["of"] == "run"
    for extra, lines in project["optional-dependencies"].items():
        for line in lines:
            row = TABLE["packages"].get(re.sub(r"[-_.]+", "-", Requirement(line).name).lower())
            assert row is None if extra == "rerun" else extra in row["of"].split(",")
