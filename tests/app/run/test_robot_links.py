"""What the loop sends must be what the controller's configuration takes in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import counterflex
from counterflex.app.run.robot_links import egm_link, rsi_link
from counterflex.app.run.session import RunSettings, one_protocol
from counterflex.core.errors import FileFormatError, InputError
from counterflex.files.cell.cell import read_cell
from counterflex.files.cell.egm import EgmTable
from counterflex.files.cell.monitor import OverrideTable
from counterflex.files.cell.online import OnlineTable
from counterflex.runtime.settings import ForceMode, OnlineSettings, Output

DEMO = Path(counterflex.__file__).parent / "app" / "demo"
HERE = "127.0.0.1"


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
        rsi_link(file, online, HERE, 0)
    other = Output.AXES if output == Output.CARTESIAN else Output.CARTESIAN
    rsi_link(file, replace(online, output=other), HERE, 0).close()


def test_a_speed_that_nobody_changes_is_not_reckoned_with(tmp_path: Path) -> None:
    file = without(tmp_path, '"Override"')
    online = OnlineSettings(force=ForceMode.MEASURED)
    with pytest.raises(InputError, match="no speed of the program"):
        rsi_link(file, online, HERE, 0, overriding=True)
    rsi_link(file, online, HERE, 0).close()
    rsi_link(DEMO / "rsi.xml", online, HERE, 0, overriding=True).close()


def test_path_correction_over_egm_changes_no_speed() -> None:
    cell = read_cell(DEMO / "cell.toml")
    table = OnlineTable(force="measured", period_ms=24)
    tables = cell.tables.model_copy(update={"egm": EgmTable(mode="path"), "online": table, "override": OverrideTable()})
    with pytest.raises(InputError, match="cannot change the speed"):
        egm_link(
            replace(cell, tables=tables),
            table.settings(cell.tables.timing, compensated=False),
            None,
            compensated=False,
            watch_only=True,
            host=HERE,
            port=0,
        )


def test_another_file_given_as_the_rsi_configuration_is_refused_before_anything_else(tmp_path: Path) -> None:
    """The cell does not exist: the configuration is read before it, and long before the kernels are compiled."""
    file = tmp_path / "cell.toml"
    file.write_text('format = "counterflex-cell"\n')
    with pytest.raises(FileFormatError, match="not an XML file"):
        one_protocol(RunSettings(tmp_path / "missing.toml", rsi=file))
