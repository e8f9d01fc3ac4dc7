"""Options with which every benchmark is run briefly: all that it has, in as few runs as they can be together.

Checked: an option that a benchmark has and no run uses is an error (tests/tools/test_run_benchmarks.py).
"""

from __future__ import annotations

from typing import Final

FOLDER: Final = "{folder}"
"""Stands for a temporary folder of the run."""
BRIEF: Final = ("--quick",)
RUNS: Final[dict[str, tuple[tuple[str, ...], ...]]] = {
    "accuracy": (
        (
            *("--quick", "--store", "--out", f"{FOLDER}/out", "--programs", "groove", "--family", "wide"),
            *("--levels", "catalogue", "--seeds", "1-1", "--workers", "1", "--calibrate"),
        ),
        ("--show",),
    ),
    "campaign_capacity": (("--quick", "--seeds", "1", "--json"),),
    "compensate": (("--quick", "--folder", "examples/programs", "--json"),),
    "compensate_growth": (("--quick", "--json"), ("--quick", "--program", "examples/programs/cylinder_ball.ngc")),
    "correct": (
        (
            *("--quick", "--noise", "--store", "--out", f"{FOLDER}/out", "--programs", "groove", "--family", "wide"),
            *("--seeds", "1-1", "--workers", "1"),
        ),
        ("--show",),
    ),
    "cutting_force": (("--quick", "--seeds", "0", "--count", "12"),),
    "day_log": (
        ("--quick", "--log", f"{FOLDER}/log", "--json", f"{FOLDER}/figures.json"),
        ("--hours", "0.002", "--whole"),
    ),
    "elastic_step": (("--quick", "--json", f"{FOLDER}/figures.json"),),
    "first_day": (("--quick", "--out", f"{FOLDER}/out", "--family", "wide", "--seeds", "1-1", "--workers", "1"),),
    "headline": (("--quick", "--out", f"{FOLDER}/out", "--levels", "catalogue", "--store"),),
    "identify": (("--quick", "--json"),),
    "interval_coverage": (
        ("--quick", "--each", "--seeds", "1", "--first", "0"),
        ("--quick", "--recipe", "cutting", "--json"),
    ),
    "ledger": (("--quick", "--predict", "--reveal", "--seeds", "1-1", "--out", f"{FOLDER}/out"), ("--store",)),
    "monitoring": (("--quick", "--grid", "--others"), ("--seeds", "1", "--first", "0")),
    "online_reply": (
        ("--quick", "--seconds", "2", "--json", f"{FOLDER}/figures.json"),
        ("--quick", "--stages", "--spin-us", "300"),
    ),
    "panel": (("--quick", "--minutes", "1", "--block", "1", "--json", f"{FOLDER}/figures.json"),),
    "panel_stop": (("--quick", "--logins", "100", "--stops", "2", "--json", f"{FOLDER}/figures.json"),),
    "placement": (
        ("--quick", "--candidates", "64"),
        ("--gain", "groove", "--candidates", "64", "--seeds", "1-1"),
        ("--operations", "--candidates", "64"),
    ),
    "plan_better": (
        (
            *("--quick", "--store", "--out", f"{FOLDER}/out", "--levels", "catalogue", "--seeds", "1-1"),
            *("--workers", "1", "--candidates", "64"),
        ),
        ("--show",),
    ),
    "plan_wall": (
        (
            *("--quick", "--seeds", "200-200", "--workpieces", "EN AW-7075", "--candidates", "64", "--workers", "1"),
            *("--write", f"{FOLDER}/rows.json"),
        ),
    ),
    "play_quick_form": (("--quick", "--seeds", "1", "--first", "0", "--json"),),
    "posture": (("--quick", "--gain", "--seeds", "1-1"),),
    "production": (
        ("--quick", "--drawn", "--series", "--family", "mild", "--seeds", "1-1"),
        ("--show", "--out", f"{FOLDER}/none"),
        ("--short",),
    ),
    "quote_reliability": (
        (
            *("--quick", "--store", "--out", f"{FOLDER}/out", "--programs", "groove", "--family", "wide"),
            *("--variants", "compensated", "--seeds", "1-1"),
        ),
        ("--show",),
    ),
    "remaining_time": (("--quick", "--cold", "--only", "--period", "0.5", "--out", f"{FOLDER}/figures.json"),),
    "removal": (
        ("--quick", "--json", f"{FOLDER}/figures.json"),
        (
            *("--quick", "--program", "examples/programs/cylinder_ball.ngc"),
            *("--adaptive", "examples/programs/fc_grooves_pocket.ngc"),
        ),
    ),
    "scan": (
        (
            *("--quick", "--program", "examples/programs/groove.ngc", "--cell", "examples/cells/kr300_d16_small.toml"),
            *("--seeds", "1001-1001", "--points", "150000"),
        ),
        ("--quick", "--write", f"{FOLDER}/scan.ply"),
        ("--memory", "150000"),
    ),
    "soft_entry": (("--quick", "--seeds", "1-1", "--cases", "slot plunged"),),
    "step_stability": (
        ("--quick", "--robots", "kuka_kr270_2", "--seeds", "1-1", "--family", "mild", "--postures", "4"),
    ),
    "studio": (("--quick", "--points", "2000", "--minutes", "0", "--json", f"{FOLDER}/figures.json"),),
    "tool_log": (
        (
            *("--quick", "--program", "examples/programs/groove.ngc", "--cell", "examples/cells/kr300_d16_small.toml"),
            *("--seeds", "1001-1001", "--noise-um", "15"),
        ),
    ),
    "tridexel": (
        ("--quick", "--json", f"{FOLDER}/figures.json", "--mesh", f"{FOLDER}/impeller.stl"),
        ("--quick", "--columns"),
        ("--quick", "--roughing"),
    ),
    "truth_pieces": (
        (
            *("--quick", "--out", f"{FOLDER}/out", "--programs", "groove", "--levels", "catalogue", "exact"),
            *("--seeds", "0"),
        ),
    ),
    "twin_speed": (("--quick", "--json"),),
    "wall_finish": (
        ("--quick", "--seeds", "1-1", "--family", "wide", "--materials", "EN AW-7075", "--variants", "before"),
    ),
}
"""By name of the benchmark, a tuple of words for each run; one that is not here is run with ``--quick`` alone."""
STORES: Final = "--store"
"""Writes results and pages beside the benchmark: such a run works on a copy of them."""


def runs_of(name: str) -> tuple[tuple[str, ...], ...]:
    """Words of each brief run of a benchmark."""
    return RUNS.get(name, (BRIEF,))
