"""What the loop sends must be what the controller's configuration takes in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import counterflex
from counterflex.app.run.robot_links import ROBOT_LINKS, LinkOrder, chosen, values_of
from counterflex.app.run.session import RunSettings, one_protocol
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import Cell, read_cell
from counterflex.files.cell.links import EgmTable
from counterflex.files.cell.monitor import OverrideTable
from counterflex.files.cell.online import OnlineTable
from counterflex.protocols.robot.link import RobotLink
from counterflex.runtime.settings import ForceMode, OnlineSettings, Output

DEMO = Path(counterflex.__file__).parent / "app" / "demo"


def rsi_link(file: Path, online: OnlineSettings, **changes: Any) -> RobotLink:
    """The link of a configuration in the demonstration's cell."""
    order = LinkOrder(cell=read_cell(DEMO / "cell.toml"), file=file, online=online, port=0, **changes)
    return ROBOT_LINKS["rsi"].open(order)


def without(tmp_path: Path, word: str) -> Path:
    """The demonstration's configuration without the lines that hold a word."""
    lines = (DEMO / "rsi.xml").read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if word not in line]
    assert len(kept) < len(lines)
    file = tmp_path / "rsi.xml"
    file.write_text("\n".join(kept), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("word", "output", "said"),
    [("RKorr", Output.CARTESIAN, "no Cartesian correction"), ("AKorr", Output.AXES, "no axis corrections")],
)
def test_a_correction_that_would_go_nowhere_is_refused(tmp_path: Path, word: str, output: Output, said: str) -> None:
    file = without(tmp_path, word)
    online = OnlineSettings(force=ForceMode.MEASURED, output=output)
    with pytest.raises(InputError, match=said):
        rsi_link(file, online)
    other = Output.AXES if output == Output.CARTESIAN else Output.CARTESIAN
    rsi_link(file, replace(online, output=other)).close()


def test_a_speed_that_nobody_changes_is_not_reckoned_with(tmp_path: Path) -> None:
    file = without(tmp_path, '"Override"')
    online = OnlineSettings(force=ForceMode.MEASURED)
    with pytest.raises(InputError, match="no speed of the program"):
        rsi_link(file, online, overriding=True)
    rsi_link(file, online).close()
    rsi_link(DEMO / "rsi.xml", online, overriding=True).close()


def test_path_correction_over_egm_changes_no_speed() -> None:
    cell = read_cell(DEMO / "cell.toml")
    table = OnlineTable(force="measured", period_ms=24)
    tables = cell.tables.model_copy(update={"egm": EgmTable(mode="path"), "online": table, "override": OverrideTable()})
    with pytest.raises(InputError, match="cannot change the speed"):
        online = table.settings(cell.tables.timing, compensated=False)
        ROBOT_LINKS["egm"].open(LinkOrder(cell=replace(cell, tables=tables), online=online, port=0))


def test_another_file_given_as_the_rsi_configuration_is_refused_before_anything_else(tmp_path: Path) -> None:
    """The cell does not exist: the configuration is read before it, and long before the kernels are compiled."""
    file = tmp_path / "cell.toml"
    file.write_text('format = "counterflex-cell"\n')
    with pytest.raises(FileFormatError, match="not an XML file"):
        one_protocol(RunSettings(tmp_path / "missing.toml", ("rsi", file)))


def test_the_cell_file_names_the_link_and_nothing_else_may_be_given(tmp_path: Path) -> None:
    text = (DEMO / "cell.toml").read_text(encoding="utf-8") + '\n[online]\nforce = "pilot"\n'
    file = tmp_path / "cell.toml"

    def named(line: str) -> Cell:
        file.write_text(text + line, encoding="utf-8")
        return read_cell(file)

    assert chosen(None, named('protocol = "egm"\n')) == ("egm", None)
    assert chosen(("rsi", file), named("")) == ("rsi", file)
    for line, given, said in (
        ("", None, "protocol is not clear"),
        ('protocol = "egm"\n', ("rsi", file), "protocol is not clear"),
        ('protocol = "rsi"\n', None, "the link rsi needs a file"),
        ("", ("egm", file), "the link egm has no file"),
        ('protocol = "egn"\n', None, "Did you mean 'egm'"),
    ):
        with pytest.raises(InputError, match=said):
            chosen(given, named(line))
    with pytest.raises(FileFormatError, match="no key port"):
        values_of("egm", named("[online.link]\nport = 1\n"))
