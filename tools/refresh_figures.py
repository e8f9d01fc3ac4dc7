"""Rewrite the marked block of figures in README.md from the summary of a demonstration.

counterflex demo --seeds 5 --out out/demo
python tools/refresh_figures.py out/demo/summary.json
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from counterflex.evaluate.truth_level import TRUTH_LEVELS
from counterflex.files.summary_file import read_summary

README = Path(__file__).resolve().parents[1] / "README.md"
_BLOCK = re.compile(r"(<!-- figures: begin[^\n]*-->\n).*?(<!-- figures: end -->)", re.DOTALL)
PARTS = {"path": "path", "entry": "tool entry", "exit": "tool exit", "surface": "machined surface"}


def block(summary: dict[str, Any]) -> str:
    """The figures as Markdown: the first seed's table, what remains over all seeds, and where the peak is."""
    seeds = sorted({row["seed"] for row in summary["seeds"]})
    many = f" --seeds {len(seeds)}" if len(seeds) > 1 else ""
    command, version = f"counterflex demo{many} --out out/demo", summary["counterflex"]
    first = summary["variants"]
    lines = [
        f"Printed by `{command}` (version {version}), truth seed {seeds[0]}, mm:",
        "",
        "| deviation | 99.7 % before | after | largest before | after |",
        "|---|---|---|---|---|",
    ]
    for part, name in PARTS.items():
        before, after = first["nominal"][part], first["compensated"][part]
        lines.append(
            f"| {name} | {before['p997_mm']:.2f} | **{after['p997_mm']:.2f}** | "
            f"{before['max_mm']:.2f} | **{after['max_mm']:.2f}** |"
        )
    lines += ["", "Path error after compensation, in percent of the uncompensated error:", ""]
    lines += [
        "| the planner knows | seeds | 99.7 %, median seed | worst seed | largest, worst seed |",
        "|---|---|---|---|---|",
    ]
    for level, name in TRUTH_LEVELS.items():
        if level in summary["over_seeds"]:
            over = summary["over_seeds"][level]
            path = over["path"]
            values = (path["p997"]["median_remaining"], path["p997"]["worst_remaining"], path["max"]["worst_remaining"])
            lines.append(f"| {name} | {over['count']} | " + " | ".join(f"{100.0 * v:.0f} %" for v in values) + " |")
    found = summary["prediction"]
    force, bend = found["peak_force_n"], found["peak_deflection_um"]
    joints = ", ".join(f"{angle:.0f}" for angle in bend["joints_deg"])
    lines += [
        "",
        f"Predicted peak: {force['value']:.0f} N in line {force['line']} of the program, "
        f"{bend['value'] / 1000.0:.2f} mm in line {bend['line']} with the axes at {joints} deg.",
    ]
    return "\n".join(lines) + "\n"


def main(file: str) -> int:
    """Replace the block; 1 when the README has none."""
    text = README.read_text(encoding="utf-8")
    new, count = _BLOCK.subn(lambda match: match[1] + block(read_summary(Path(file))) + match[2], text)
    if count != 1:
        print("README.md has no marked block of figures")
        return 1
    README.write_text(new, encoding="utf-8", newline="\n")
    print("README.md: figures rewritten")
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python tools/refresh_figures.py SUMMARY.json")
    sys.exit(main(sys.argv[1]))
