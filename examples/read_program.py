"""Print what the G-code reader makes of a program: motions, what is kept, and how a fault is reported."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

from counterflex.core.errors import ProgramError
from counterflex.core.units import MM
from counterflex.programs.gcode.read.reader import read_gcode, read_gcode_file
from counterflex.programs.listing import listing

PROGRAM = Path(__file__).parent / "programs" / "fc_grooves_pocket.ngc"


def main() -> None:
    """Read a CAM system's program, then a short one with a loop, then one with a fault."""
    program = read_gcode_file(PROGRAM)
    table = listing(program)
    print(f"{program.name}: {len(program.lines)} lines, {len(program.blocks)} blocks, {len(program.motions)} motions")
    print(dict(Counter(table["motion"].to_list())))

    drilled = read_gcode(
        "G21 G90 G17 F600\n#<pitch> = 20\nG0 X0 Y0 Z10\n"
        "O100 repeat [3]\n  G91 G81 X#<pitch> Z-8 R-7\nO100 endrepeat\nM2\n"
    )
    print("three holes drilled by a loop; the moves that the last one stands for:")
    for motion in drilled.motions[-4:]:
        x, y, z = (float(value) / MM for value in motion.p_end[:3])
        print(f"  line {drilled.blocks[motion.block].line}: to x {x:g} y {y:g} z {z:g} mm")

    for text in ("G21 G1 X10 F100\nG1 X20 Q5\nM2\n", "G21 G41 D1 X10\nM2\n"):
        try:
            read_gcode(text, name="mistake.ngc")
        except ProgramError as fault:
            print(f"refused: {fault}")


if __name__ == "__main__":
    main()
