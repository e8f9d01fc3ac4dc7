"""Remake the golden files of the G-code corpus with LinuxCNC's own interpreter.

    tools/fetch_rs274.sh
    python tools/make_rs274_golden.py

Each ``tests/data/gcode/**/NAME.ngc`` gets ``NAME.canon``: the canonical calls that LinuxCNC makes for it, without line
numbers and comments. Tool lengths and stored positions are those of :data:`TOOL_LENGTHS_MM` and :data:`PARAMETERS`;
the tests hand the same to the reader.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
RS274: Final = ROOT / ".tools" / "rs274"
DATA: Final = ROOT / "tests" / "data" / "gcode"
TOOL_LENGTHS_MM: Final = {1: 0.0, 2: 12.5, 3: 80.25, 7: 33.0}
PARAMETERS: Final[dict[int, float]] = {
    5161: 5.0, 5162: 6.0, 5163: 90.0, 5164: 0.0, 5165: 0.0, 5166: 0.0,
    5181: -15.0, 5182: 26.0, 5183: 70.0, 5184: 0.0, 5185: 0.0, 5186: 0.0,
}  # fmt: skip
_CALL: Final = re.compile(r"^\s*\d+ N\.*\d*\s+([A-Z0-9_]+\(.*\))\s*$")


def canonical_calls(program: Path) -> list[str]:
    """Run LinuxCNC's interpreter on a program and return its canonical calls.

    Args:
        program: The file.

    Returns:
        Calls in order, comments left out.

    Raises:
        RuntimeError: The interpreter refuses the program; the message is its own.
    """
    with tempfile.TemporaryDirectory() as folder:
        tools, variables = Path(folder) / "tool.tbl", Path(folder) / "rs274.var"
        tools.write_text(
            "".join(f"T{n} P{n} Z{z / 25.4:.12f} D0.4\n" for n, z in TOOL_LENGTHS_MM.items()), encoding="ascii"
        )
        needed = sorted(
            {*range(5161, 5170), *range(5181, 5190), *range(5210, 5221), *PARAMETERS}
            | {base + axis for base in range(5221, 5390, 20) for axis in range(10)}
        )
        # Stand-alone, the interpreter's machine measures in inches.
        lines = [f"{n}\t{1.0 if n == 5220 else PARAMETERS.get(n, 0.0) / 25.4:.12f}\n" for n in needed]
        variables.write_text("".join(lines), encoding="ascii")
        done = subprocess.run(
            [str(RS274), "-t", str(tools), "-v", str(variables), "-g", str(program.resolve())],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
            cwd=folder,
            env={**os.environ, "HOME": folder},
        )
    output = done.stdout
    if "PROGRAM_END" not in output and done.returncode != 0:
        tail = " ".join((done.stdout[-300:] + done.stderr[-600:]).split())
        raise RuntimeError(f"rs274 refuses {program.name}: {tail}")
    matches = (_CALL.match(line) for line in output.splitlines())
    return [match[1] for match in matches if match and not match[1].startswith(("COMMENT(", "MESSAGE("))]


def main() -> int:
    """Write every golden file; say which changed."""
    if not RS274.exists():
        print("run tools/fetch_rs274.sh first", file=sys.stderr)
        return 2
    for program in sorted(DATA.rglob("*.ngc")):
        golden = program.with_suffix(".canon")
        text = "\n".join(canonical_calls(program)) + "\n"
        if not golden.exists() or golden.read_text(encoding="ascii") != text:
            golden.write_text(text, encoding="ascii", newline="\n")
            print(f"changed {golden.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
