"""The example gallery: scripts are whole, notebooks valid and runnable; pages made from the program have all of it."""

from __future__ import annotations

import ast
import importlib
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import nbformat
import plotly.graph_objects as go
import pytest
import typer

from counterflex.cli.main import PANELS, whole

ROOT = Path(__file__).resolve().parents[2]
GALLERY = ROOT / "examples" / "gallery"
SCRIPTS = sorted(GALLERY.rglob("*.py"))
LONGEST = 120
"""Characters of a line of text."""


@pytest.fixture(scope="module")
def tools() -> Iterator[Any]:
    """Tools that the documentation is built with."""
    sys.path.insert(0, str(ROOT / "tools"))
    try:
        names = ("docs_site.gallery", "docs_site.command_help", "docs_site.rooms", "notebooks", "picture_gallery")
        yield [importlib.import_module(name) for name in names]
    finally:
        sys.path.remove(str(ROOT / "tools"))


def _module(tools: list[ModuleType], name: str) -> Any:
    return next(module for module in tools if module.__name__ == name)


def test_every_script_belongs_to_a_section(tools: list[ModuleType]) -> None:
    gallery = _module(tools, "docs_site.gallery")
    assert sorted(gallery.scripts()) == SCRIPTS
    assert len(SCRIPTS) >= 8
    for section in gallery.SECTIONS:
        assert (GALLERY / section / "GALLERY_HEADER.rst").is_file()


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda file: file.stem)
def test_a_script_is_a_page(script: Path) -> None:
    """Title, picture, a row in the page of the laboratory; nothing but the package is needed where it runs."""
    text = script.read_text(encoding="utf-8")
    title, line = (ast.get_docstring(ast.parse(text)) or "").splitlines()[:2]
    assert set(line) == {"="}
    assert len(line) >= len(title)
    picture = re.search(r'^# sphinx_gallery_thumbnail_path = "(.+)"$', text, re.MULTILINE)
    assert picture is not None
    assert (ROOT / "docs" / picture[1]).is_file()
    row = f"(../{script.relative_to(ROOT).as_posix()})"
    assert row in (ROOT / "docs" / "laboratory.md").read_text(encoding="utf-8")
    assert "__file__" not in text
    assert "# %%" in text


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda file: file.stem)
def test_a_notebook_is_valid_and_has_the_whole_script(tools: list[ModuleType], script: Path) -> None:
    made = _module(tools, "notebooks").notebook_of(script)
    notebook = nbformat.reads(json.dumps(made), as_version=nbformat.NO_CONVERT)
    nbformat.validate(notebook)
    cells = [cell["source"] for cell in notebook.cells if cell["cell_type"] == "code"]
    assert len(cells) >= 3
    whole = [ast.dump(node) for node in ast.parse(script.read_text(encoding="utf-8")).body[1:]]
    assert [ast.dump(node) for cell in cells for node in ast.parse(cell).body] == whole
    assert any("sphinx_gallery_" in cell for cell in cells) is False


def test_the_cells_of_a_notebook_run_in_order(tools: list[ModuleType]) -> None:
    """As a kernel runs them: one name space, the last expression of a cell shown; without a file beside it."""
    made = _module(tools, "notebooks").notebook_of(GALLERY / "cutting" / "slot_force.py")
    names: dict[str, Any] = {"__name__": "__main__"}
    shown = []
    for cell in made["cells"]:
        if cell["cell_type"] != "code":
            continue
        body = ast.parse("".join(cell["source"]))
        last = body.body.pop() if isinstance(body.body[-1], ast.Expr) else None
        exec(compile(body, "cell", "exec"), names)
        if isinstance(last, ast.Expr):
            shown.append(eval(compile(ast.Expression(last.value), "cell", "eval"), names))
    assert sum(isinstance(item, go.Figure) for item in shown) == 2
    assert names["rows"][0]["teeth"] == "straight teeth, circular path"
    names["scratch"].cleanup()  # a notebook keeps its folder until its kernel ends


def test_notebooks_are_written_by_their_command(
    tools: list[ModuleType], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _module(tools, "notebooks").main(tmp_path) == 0
    written = sorted(file.relative_to(tmp_path).with_suffix(".py").as_posix() for file in tmp_path.rglob("*.ipynb"))
    assert written == [script.relative_to(GALLERY).as_posix() for script in SCRIPTS]
    assert len(capsys.readouterr().out.splitlines()) == len(written)


@pytest.mark.parametrize(
    ("text", "depth", "page"),
    [
        ("[a](../examples/gallery/robot/posture.py)", 0, "[a](gallery/robot/posture.rst)"),
        ("[a](../../examples/gallery/)", 1, "[a](../gallery/index.rst)"),
        ("[a](../examples/programs/groove.ngc)", 0, "[a](../examples/programs/groove.ngc)"),
    ],
)
def test_links_to_scripts_lead_to_their_pages(tools: list[ModuleType], text: str, depth: int, page: str) -> None:
    assert _module(tools, "docs_site.gallery").to_pages(text, depth) == page


def test_a_figure_stands_in_its_page_and_is_found_there(tools: list[ModuleType]) -> None:
    figure = go.Figure(go.Scatter(x=[0, 1], y=[2, 3], name="a < b & </script>"), layout={"height": 333})
    text = _module(tools, "docs_site.gallery").place(figure.to_plotly_json())
    assert "height:333px" in text
    assert text.count("</script>") == 1
    (found,) = _module(tools, "picture_gallery").figures(text)
    assert found["data"][0]["name"] == "a < b & </script>"
    assert found["data"][0]["y"] == [2, 3]


def test_the_page_of_the_help_has_every_command(tools: list[ModuleType]) -> None:
    help_of = _module(tools, "docs_site.command_help")
    found = {name: text for heading in PANELS for name, text in help_of.texts(heading)}

    def commands(command: Any, before: str = "") -> set[str]:
        below = getattr(command, "commands", {})
        inner = (commands(item, f"{before} {name}".strip()) for name, item in below.items())
        return set().union(*inner) if below else {before}

    assert set(found) == commands(typer.main.get_command(whole()))
    for name, text in found.items():
        assert text.startswith(f"Usage: counterflex {name} ")
        assert max(map(len, text.splitlines())) <= LONGEST


def test_a_room_has_its_public_modules_and_no_kernels(tools: list[ModuleType]) -> None:
    rooms = _module(tools, "docs_site.rooms")
    assert "counterflex.geometry.pose" in rooms.modules("counterflex.geometry")
    assert not any("kernel" in name or "__init__" in name for name in rooms.modules("counterflex.robot"))
    assert rooms.modules("counterflex.geometry.pose") == ["counterflex.geometry.pose"]
    some = rooms.chosen("counterflex.robot", ["kinematics.inverse", "elasticity.chain"])
    assert some == ["counterflex.robot.kinematics.inverse", "counterflex.robot.elasticity.chain"]
    with pytest.raises(ValueError, match="no public module: counterflex.robot.arm"):
        rooms.chosen("counterflex.robot", ["arm"])


def test_indented_formulas_are_literal_and_sections_stay(tools: list[ModuleType]) -> None:
    text = [
        "Error of a place.",
        "",
        "With N,",
        "",
        "    e = |N C w|",
        "",
        "    s = 1",
        "",
        "Args:",
        "    x: m.",
        "",
        "        more.",
    ]
    shown = _module(tools, "docs_site.rooms").with_formulas(text)
    assert shown == [*text[:4], "::", "", *text[4:]]
    plain = _module(tools, "docs_site.rooms").without_substitutions
    assert plain("h |sin| of ``|a|``, `` + `` and ``b``") == r"h \|sin\| of ``|a|``, ``+`` and ``b``"


def test_array_types_have_their_names_in_signatures(tools: list[ModuleType]) -> None:
    named = _module(tools, "docs_site.rooms").with_aliases("(q: TypeAliasForwardRef('Float') | None) -> Float")
    assert named == "(q: Float | None) -> Float"
