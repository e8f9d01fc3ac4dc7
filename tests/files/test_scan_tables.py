"""Tables of points as instruments and people write them give the points that were written, or are named."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError
from counterflex.files.scan.read import read_scan
from counterflex.files.scan.scan import Scan

POINTS = np.array([[10.125, -20.5, 3.25], [1234.5, 2001.75, -17.0], [-0.5, 7.125, 1000.0], [15.25, 16.5, 17.75]])


def points_of(scan: Scan) -> Float:
    """All points in file units."""
    out: Float = np.concatenate(scan.chunks).astype(np.float64) + scan.origin
    return out


def rows(form: Callable[[float], str], separator: str, header: str = "") -> str:
    """The points as a table."""
    lines = [separator.join(form(value) for value in row) for row in POINTS.tolist()]
    return "\n".join(([header] if header else []) + lines) + "\n"


def german(value: float) -> str:
    """1.234,500."""
    return f"{value:,.3f}".translate(str.maketrans(",.", ".,"))


TABLES: dict[str, bytes] = {
    "plain": rows(lambda v: f"{v:.3f}", " ").encode(),
    "decimal comma": rows(lambda v: f"{v:.3f}".replace(".", ","), ";").encode(),
    "grouped by commas": rows(lambda v: f"{v:,.3f}", "\t").encode(),
    "grouped by points": rows(german, ";").encode(),
    "grouped by quotes": rows(lambda v: f"{v:,.3f}".replace(",", "'"), ";").encode(),
    "grouped by spaces": rows(lambda v: f"{v:,.3f}".replace(",", " ").replace(".", ","), ";").encode(),
    "grouped within quotation marks": rows(lambda v: f'"{v:,.3f}"', ",", "x,y,z").encode(),
    "utf-16 with a mark": rows(lambda v: f"{v:.3f}", " ").encode("utf-16"),
    "utf-16 big end first": rows(lambda v: f"{v:.3f}", "\t", "X\tY\tZ").encode("utf-16-be"),
    "utf-16 of a comma": rows(lambda v: f"{v:.3f}".replace(".", ","), ";").encode("utf-16-le"),
    "names and places": "".join(f"P{k};A;{r[0]};{r[1]};{r[2]}\n" for k, r in enumerate(POINTS.tolist())).encode(),
    "lines that are numbered": "".join(
        f"{k + 7} {r[0]} {r[1]} {r[2]} 0.01\n" for k, r in enumerate(POINTS.tolist())
    ).encode(),
    "named otherwise": rows(lambda v: f"{v:.3f}", ",", "PosX,PosY,PosZ").encode(),
    "a title above": rows(lambda v: f"{v:.3f}", " ", "points of monday").encode(),
    "x= y= z=": "".join(f"P{k}, X={r[0]}, Y={r[1]}, Z={r[2]}\n" for k, r in enumerate(POINTS.tolist())).encode(),
    "x= y= z= below each other": "".join(
        f"POINT P{k}\n  X = {r[0]:.3f}\n  Y = {r[1]:.3f}\n  Z = {r[2]:.3f}\n" for k, r in enumerate(POINTS.tolist())
    ).encode(),
}


def axis_rows(separator: str, header: str, form: Callable[[float], str]) -> bytes:
    """One row for each axis; nominal value first, deviation last, and rows of a diameter between."""
    lines = [header]
    for k, row in enumerate(POINTS.tolist()):
        for axis, value in zip("XYZ", row, strict=True):
            lines.append(separator.join([f"P{k}", axis, form(value - 0.5), form(value), form(0.5)]))
        lines += [separator.join([f"C{k}", a, form(1.0), form(1.0), form(0.0)]) for a in "XYD"]
    return ("\n".join(lines) + "\n").encode()


TABLES |= {
    "one row an axis": axis_rows(",", "Feature,Axis,Nominal,Actual,Deviation", lambda v: f"{v:.3f}"),
    "one row an axis, semicolons": axis_rows(";", "Name;Achse;Soll;Ist;Abw", lambda v: f"{v:.3f}".replace(".", ",")),
    "one row an axis, spaces": axis_rows(" ", "NAME AX NOMINAL MEAS DEV", lambda v: f"{v:.3f}"),
    "a report of dimensions": "".join(
        f"DIM LOC{k}= LOCATION OF POINT PNT{k} UNITS=MM\nAX NOMINAL +TOL -TOL MEAS DEV OUTTOL\n"
        + "".join(f"{a} {v - 0.5:.4f} 0.1000 -0.1000 {v:.4f} 0.5000 0.4000\n" for a, v in zip("XYZ", r, strict=True))
        for k, r in enumerate(POINTS.tolist())
    ).encode(),
}


@pytest.mark.parametrize("name", TABLES)
def test_a_table_gives_its_points(tmp_path: Path, name: str) -> None:
    file = tmp_path / "s.txt"
    file.write_bytes(TABLES[name])
    np.testing.assert_allclose(points_of(read_scan(file)), POINTS, atol=2e-4)


@pytest.mark.parametrize("row", ["1.0 2.0 *", "* * *", "*** *** ***"])
@pytest.mark.parametrize("separator", [" ", ";", "\t", ","])
def test_points_that_were_not_measured_are_counted(tmp_path: Path, separator: str, row: str) -> None:
    file = tmp_path / "s.txt"
    text = rows(lambda v: f"{v:.3f}", separator)
    file.write_text(text + row.replace(" ", separator) + "\n" + text)
    scan = read_scan(file)
    assert len(scan) == 2 * len(POINTS)
    assert scan.dropped == 1


REFUSED: dict[str, tuple[str, list[str]]] = {
    "a header of other things": ("Nominal,Actual,Deviation\n1,2,3\n4,5,6\n", ["no columns of x, y and z", "Nominal"]),
    "one row an axis without a measured column": (
        "P1,X,1.0,1.1\nP1,Y,2.0,2.1\nP1,Z,3.0,3.1\n",
        ["one row for each axis", "Actual"],
    ),
    "polar": ("r,theta,phi\n1,2,3\n", ["no columns of x, y and z"]),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_table_of_something_else_is_refused(tmp_path: Path, name: str) -> None:
    text, words = REFUSED[name]
    file = tmp_path / "s.csv"
    file.write_text(text)
    with pytest.raises(FileFormatError) as error:
        read_scan(file)
    for word in words:
        assert word in str(error.value)
