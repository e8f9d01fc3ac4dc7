"""A registered object with a missing or wrong part is refused with one sentence when it is registered, not at use."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from counterflex.app.extensions import REGISTRIES, Extension, extensions
from counterflex.core.errors import InputError
from counterflex.core.registry import misfits
from counterflex.programs.language import LANGUAGES, at_prompt, dialect_at, dialects, is_robot
from counterflex.programs.reading import read_program_file

LANGUAGE = """
import re
from counterflex.programs.language import Language, Signs, StatementForms
from counterflex.programs.limits import Limits
def read(file, *, cell=None, complete=True): ...
def short(file, *, cell=None): ...
def one(order): ...
FORMS = StatementForms(lambda why: [why], {pause!r}, lambda *_: [], {in_place}, "'", "a", "b", {data_key!r})
LANGUAGE = Language(title="odd", short="odd", forms=FORMS, {more})
"""
FORMS = {"pause": "Dly {}", "in_place": (), "data_key": "tool_data"}
WHOLE = "read=read, cell=one, write=one, convert=one"
MAKER = """
from counterflex.robot.model.controller_axes import Maker
AXES = Maker("Odd", {language!r}, {signs}, (0.0,) * 6, {axis_3!r}, {world!r}, "test")
"""
ARM = {"language": "krl", "signs": (1,) * 6, "axis_3": "upper_arm", "world": "floor"}


def fault_of(name: str) -> str:
    """What ``counterflex extensions`` says of the registered object."""
    return Extension.of(next(registry for registry in REGISTRIES if name in registry), name).fault


@pytest.mark.parametrize(
    ("forms", "more", "said"),
    [
        ({}, "read='added:reed', cell=one", "read = added:reed cannot be imported: AttributeError"),
        ({}, "read='addled:read', cell=one", "read = addled:read cannot be imported: ModuleNotFoundError"),
        ({}, "read=read", "cell is missing"),
        ({}, "convert=one", "read is missing"),
        ({}, "in_place=one, cell=one", "read is missing"),
        ({}, "read=short, cell=one", "read is not called as it must be: got an unexpected keyword argument 'complete'"),
        ({}, "read=read, cell=FORMS", r"cell = StatementForms\(.* is no"),
        ({}, f"{WHOLE}, in_place=one", "in_place is not called as it must be"),
        ({}, f"{WHOLE}, load=one", "load is not called as it must be"),
        ({}, f"{WHOLE}, prompt='krl'", "the name krl at the prompt is that of krl"),
        ({}, f"{WHOLE}, endings=('.prg')", r"an ending is a dot and lower-case characters; got '\.prg'"),
        ({}, f"{WHOLE}, endings=('prg',)", "an ending is a dot"),
        ({}, f"{WHOLE}, signs=Signs('odd', (r'^Mov[',))", "no regular expression"),
        ({}, f"{WHOLE}, comment=re.compile('#')", "needs a group"),
        ({}, f"{WHOLE}, tool_stays='no'", "tool_stays = 'no' is no bool"),
        ({}, f"{WHOLE}, limits=Limits(0, 1, 1, 1, 1, 'test')", "line_characters of a controller is out of range"),
        ({"pause": "Dly"}, WHOLE, "one {} for the time"),
        ({"in_place": "('Wait')"}, WHOLE, r"forms\.in_place = 'Wait' is no tuple"),
        ({"data_key": "tool"}, WHOLE, r"forms\.data_key = 'tool' is no Literal\['tool_data', 'tooldata'\]"),
    ],
)
def test_a_language_with_a_wrong_part_is_refused(
    package: Callable[[str, str, str], None], forms: dict[str, object], more: str, said: str
) -> None:
    source = LANGUAGE.format(**{**FORMS, **forms}, more=more)
    package("counterflex.languages", "odd = added:LANGUAGE", source)
    assert re.search(said, fault_of("odd"))
    assert at_prompt("convert")["krl"] == "krl"  # no package takes a name of ours


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"signs": (1,) * 5}, "six signs"),
        ({"signs": (1, 1, 1, 1, 1, 2)}, "six signs"),
        ({"axis_3": "horizonal"}, "axis_3 = 'horizonal' is no"),
        ({"world": "flor"}, r"world = 'flor' is no Literal\['floor', 'axis 2'\]"),
        ({"language": "odd"}, "no language odd is registered"),
    ],
)
def test_a_maker_with_a_wrong_part_is_refused(
    package: Callable[[str, str, str], None], change: dict[str, object], said: str
) -> None:
    package("counterflex.controllers", "odd = added:AXES", MAKER.format(**{**ARM, **change}))
    assert re.search(said, fault_of("odd"))


def test_a_link_names_a_controller_that_can_be_imported(package: Callable[[str, str, str], None]) -> None:
    source = "from counterflex.app.run.robot_links import RobotLinkKind\n"
    source += "LINK = RobotLinkKind(title='odd', open=print, simulated='added:controler')"
    package("counterflex.robot_links", "odd = added:LINK", source)
    assert "simulated = added:controler cannot be imported" in fault_of("odd")


def test_a_language_that_cannot_be_loaded_says_why_where_it_is_named(
    package: Callable[[str, str, str], None], tmp_path: Path
) -> None:
    package("counterflex.languages", "odd = added:LANGUAGE", LANGUAGE.format(**FORMS, more="convert=one"))
    program = tmp_path / "part.odd"
    program.write_text("Mvs P1\n", encoding="ascii")
    assert "odd" in dialects()
    with pytest.raises(InputError, match="read is missing"):
        read_program_file(program, dialect="odd")
    with pytest.raises(InputError, match="read is missing"):
        is_robot(dialect_at("odd", "convert"))


def test_a_sound_language_and_all_of_ours_have_no_fault(package: Callable[[str, str, str], None]) -> None:
    package("counterflex.languages", "odd = added:LANGUAGE", LANGUAGE.format(**FORMS, more=WHOLE))
    assert [(item.name, item.fault) for item in extensions() if item.fault] == []
    assert "odd" in LANGUAGES
    assert [wrong for registry in REGISTRIES for name in registry.own for wrong in misfits(registry[name])] == []
