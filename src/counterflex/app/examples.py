"""The demonstration cell and part that ship with the package, and what a first try of everything needs."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Final

from counterflex.core import atomic
from counterflex.core.errors import OutputError
from counterflex.robot.model import catalog
from counterflex.robot.model.controller_axes import MAKERS

ROBOT: Final = "kuka_kr300_r2500_ultra"
"""Robot of the demonstration cell."""
_ONLINE: Final = """
# How counterflex run corrects while milling. Where the force sensor sits and what hangs behind it is measured, not
# known from a drawing: identify payload writes the table [sensor].
[online]
force = "pilot"
"""
_SMALL: Final = (
    ("# Demonstration cell: ", "# Small blank, coarse height map, for quick trials with groove.ngc: "),
    ('name = "KR 300 R2500 ultra, spindle across the flange"', 'name = "KR 300 R2500 ultra, small blank"'),
    ("y_mm = -75", "y_mm = -30"),
    ("[200, 0, 40], [200, 150, 40], [0, 150, 40]]", "[60, 0, 40], [60, 60, 40], [0, 60, 40]]"),
    ("box_max_mm = [200, 150, 40]", "box_max_mm = [60, 60, 40]"),
    ("cell_mm = 0.1", "cell_mm = 0.2"),
)


def text(name: str) -> str:
    """Text of a file of the demonstration: ``cell.toml``, ``part.ngc``, ``groove.ngc`` or ``rsi.xml``."""
    return (resources.files("counterflex.app") / "demo" / name).read_text(encoding="utf-8")


def small() -> str:
    """Text of the demonstration cell with a blank of 60 x 60 x 40 mm, for ``groove.ngc``."""
    cell = text("cell.toml")
    for old, new in _SMALL:
        cell = cell.replace(old, new)
    return cell


def write(cell: Path) -> list[Path]:
    """Write the demonstration cell to a path and its part beside it.

    Raises:
        OutputError: A file is there already, or the folder cannot be written.
    """
    return _write({cell: text("cell.toml"), cell.parent / "part.ngc": text("part.ngc")})


def with_robot(cell: str, robot: str) -> str:
    """Text of a demonstration cell with another robot of the catalogue; all else, the part's place too, is as it was.

    Raises:
        InputError: The catalogue has no such robot.
    """
    model = catalog.entry(robot).model.split(" (")[0].replace('"', "'")
    _, _, rest = cell.partition("\n")  # the first line says which robot it is
    rest = rest.replace(f'catalog = "{ROBOT}"', f'catalog = "{robot}"')
    if catalog.load(robot).axes.maker != catalog.load(ROBOT).axes.maker:  # what only a KUKA has is not of this robot
        rest = rest.replace('rsi_version = "4.1"\n', "")
        rest = rest.replace("cycle_ms = 12\n", "cycle_ms = 12  # of a KUKA: enter that of your controller\n")
    rest = rest.replace('name = "KR 300 R2500 ultra', f'name = "{model}', 1)
    return f"# {model} of the catalogue; spindle, tools, material and part are those of the demonstration cell.\n{rest}"


def write_all(cell: Path, robot: str = ROBOT) -> list[Path]:
    """Write what the first steps need: a cell that also corrects online, its part, set-up of the link, a small job.

    Args:
        cell: Of the cell file, ``NAME.toml``. Beside it: ``part.ngc``, what sets up the link of the robot (for a
            KUKA ``rsi.xml``), and ``NAME-small.toml`` with ``groove.ngc``, which take seconds where the others take
            minutes.
        robot: Of the catalogue, in place of that of the demonstration.

    Raises:
        InputError: The catalogue has no such robot.
        OutputError: A file is there already, or the folder cannot be written.
    """
    folder, large, little = cell.parent, text("cell.toml"), small()
    maker = catalog.load(robot).axes.maker
    set_up = "" if maker is None else MAKERS[maker].set_up
    if robot != ROBOT:
        large, little = with_robot(large, robot), with_robot(little, robot)
    return _write(
        {
            cell: large + _ONLINE,
            folder / "part.ngc": text("part.ngc"),
            **({folder / set_up: text(set_up)} if set_up else {}),
            folder / f"{cell.stem}-small{cell.suffix}": little + _ONLINE,
            folder / "groove.ngc": text("groove.ngc"),
        }
    )


def _write(targets: Mapping[Path, str]) -> list[Path]:
    for path in targets:
        if path.exists():
            raise OutputError("the file exists and is kept", where=str(path), hint="Choose another --out")
    folder = next(iter(targets)).parent
    with atomic.atomic_folder(folder) as staging:
        for path, content in targets.items():
            atomic.write_text(staging / path.relative_to(folder), content)
    return list(targets)
