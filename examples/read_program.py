"""Print what the reader makes of a program: motions, what is kept, and how a fault is reported."""

from __future__ import annotations

import tempfile
from pathlib import Path

import polars as pl

import counterflex as cf

PROGRAM = Path(__file__).parent / "programs" / "fc_grooves_pocket.ngc"


def main() -> None:
    """Read a CAM system's program, then a short one with a loop, then one with a fault."""
    print(cf.read_program(PROGRAM))

    with tempfile.TemporaryDirectory() as scratch:
        file = Path(scratch) / "holes.ngc"
        file.write_text(
            "G21 G90 G17 F600\n#<pitch> = 20\nG0 X0 Y0 Z10\n"
            "O100 repeat [3]\n  G91 G81 X#<pitch> Z-8 R-7\nO100 endrepeat\nM2\n"
        )
        drilled = cf.read_program(file).table
        print("three holes drilled by a loop; the moves that the last one stands for:")
        for row in drilled.tail(4).select(pl.col("line", "x_mm", "y_mm", "z_mm")).iter_rows(named=True):
            print(f"  line {row['line']}: to x {row['x_mm']:g} y {row['y_mm']:g} z {row['z_mm']:g} mm")

        for text in ("G21 G1 X10 F100\nG1 X20 Q5\nM2\n", "G21 G41 D1 X10\nM2\n"):
            mistake = Path(scratch) / "mistake.ngc"
            mistake.write_text(text)
            try:
                cf.read_program(mistake)
            except cf.CounterflexError as fault:
                print(f"refused: {fault}")


if __name__ == "__main__":
    main()
