"""Rewrite the marked block of figures in README.md from the summary of a campaign on the demonstration.

counterflex campaign --family wide --seeds 1001-1005 --exact --out out/campaign
python tools/refresh_figures.py out/campaign/summary.json

The campaign identifies every cell, which takes half an hour. The summary of `counterflex prove part.ngc` with the same
options renews the other levels: rows of identified cells stay then, and the block says so.
`tests/app/proof/test_accuracy_goals.py` compares the rows of the other levels with a fresh run: figures that have
become stale fail there.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from counterflex.core import atomic
from counterflex.evaluate.summary import TRUTH_LEVELS
from counterflex.files.summary_file import read_summary

README = Path(__file__).resolve().parents[1] / "README.md"
STORED = README.parent / "benchmarks" / "results" / "readme.json"
KEPT = ("format", "version", "counterflex", "family", "truth_level", "variants", "seeds", "over_seeds", "prediction")
_BLOCK = re.compile(r"(<!-- figures: begin[^\n]*-->\n).*?(<!-- figures: end -->)", re.DOTALL)
PARTS = {"path": "path", "entry": "tool entry", "exit": "tool exit", "surface": "machined surface"}


def block(summary: dict[str, Any]) -> str:
    """The figures as Markdown: the first seed's table, what remains over all seeds, and where the peak is."""
    seeds = sorted({row["seed"] for row in summary["seeds"]})
    drawn = f"--family {summary['family']} --seeds {seeds[0]}-{seeds[-1]}"
    command = f"counterflex campaign {drawn} --exact --out out/campaign"
    first = next(row for row in summary["seeds"] if row["seed"] == seeds[0] and row["truth_level"] == "identified")
    lines = []
    headline = summary["prediction"].get("headline")
    if headline is not None:
        expected = [f"{median:.2f} mm ({low:.2f} to {high:.2f} mm)" for median, low, high in _ends(headline)]
        lines += [
            "Expected of the test part, with what is published of robot and material: "
            f"{expected[1]} after compensation, {expected[0]} before. "
            "First the median over all that is not known, then the range that nine of ten such cells lie in. "
            "Machined on simulated cells:",
            "",
        ]
    lines += [
        f"Printed by `{command}` (version {summary['counterflex']}). Identified cell, truth seed {seeds[0]}, mm:",
        "",
        "| deviation | 99.7 % before | after | largest before | after |",
        "|---|---|---|---|---|",
    ]
    for part, name in PARTS.items():
        before, after = first["variants"]["nominal"][part], first["variants"]["compensated"][part]
        lines.append(
            f"| {name} | {before['p997_mm']:.2f} | **{after['p997_mm']:.2f}** | "
            f"{before['max_mm']:.2f} | **{after['max_mm']:.2f}** |"
        )
    lines += ["", "Path error after compensation, in percent of the uncompensated error:", ""]
    lines += [
        "| the planner knows | seeds | 99.7 %, median seed | worst seed | largest, worst seed |",
        "|---|---|---|---|---|",
    ]
    for level in ("identified", "catalogue", "exact"):
        if level in summary["over_seeds"]:
            name = f"{TRUTH_LEVELS[level]} (`{level}`)"
            over = summary["over_seeds"][level]
            path = over["path"]
            values = (path["p997"]["median_remaining"], path["p997"]["worst_remaining"], path["max"]["worst_remaining"])
            lines.append(f"| {name} | {over['count']} | " + " | ".join(f"{100.0 * v:.0f} %" for v in values) + " |")
    if "identified_at" in summary:
        lines += ["", f"Identified cells: measured at commit {summary['identified_at']}, the other rows later."]
    found = summary["prediction"]
    force, bend = found["peak_force_n"], found["peak_deflection_um"]
    joints = ", ".join(f"{angle:.0f}" for angle in bend["joints_deg"])
    lines += [
        "",
        f"Predicted peak: {force['value']:.0f} N in line {force['line']} of the program, "
        f"{bend['value'] / 1000.0:.2f} mm in line {bend['line']} with the axes at {joints} deg.",
    ]
    return "\n".join(lines) + "\n"


def _ends(headline: dict[str, Any]) -> list[list[float]]:
    return [headline["before_mm"], headline["after_mm"]]


def kept(summary: dict[str, Any]) -> dict[str, Any]:
    """Part of a summary that is kept in the repository: the sources of the block, and the commit it was measured at."""
    words = ["git", "-C", str(README.parent), "describe", "--always", "--dirty", "--abbrev=10"]
    made = subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()
    return {"commit": made or "unknown", **{key: summary[key] for key in KEPT}}


def with_rows_of(new: dict[str, Any], stored: dict[str, Any]) -> dict[str, Any]:
    """Stored figures with the levels of new ones in place of their own, and the commit of the levels that stay."""
    levels = {row["truth_level"] for row in new["seeds"]}
    stay = [row for row in stored["seeds"] if row["truth_level"] not in levels]
    if not stay:
        return new
    since = stored.get("identified_at", stored["commit"])
    over = {**stored["over_seeds"], **{level: new["over_seeds"][level] for level in levels}}
    return {**new, "identified_at": since, "seeds": [*stay, *new["seeds"]], "over_seeds": over}


def with_block(text: str, summary: dict[str, Any]) -> str:
    """The README with the figures of a summary.

    Raises:
        ValueError: It has no marked block.
    """
    new, count = _BLOCK.subn(lambda match: match[1] + block(summary) + match[2], text)
    if count != 1:
        raise ValueError("README.md has no marked block of figures")
    return new


def main(file: str) -> int:
    """Replace the block and what it is made from."""
    summary = read_summary(Path(file))
    figures = kept(summary)
    if STORED.is_file():
        figures = with_rows_of(figures, json.loads(STORED.read_text(encoding="utf-8")))
    new = with_block(README.read_text(encoding="utf-8"), figures)
    STORED.parent.mkdir(exist_ok=True)
    atomic.write_text(STORED, json.dumps(figures, indent=1) + "\n")
    README.write_text(new, encoding="utf-8", newline="\n")
    print(f"README.md and {STORED.name}: figures rewritten")
    return 0


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python tools/refresh_figures.py SUMMARY.json")
    sys.exit(main(sys.argv[1]))
