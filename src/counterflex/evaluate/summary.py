"""The summary of a job: a versioned plain dictionary, in shop units, that ``summary.json`` holds.

Its layout is described in ``docs/summary.md``. Every accuracy figure of the project is defined in this room; the
summary only collects them.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import MM
from counterflex.evaluate.figures import DeviationFigures, reduction
from counterflex.evaluate.path_deviation import PathFigures
from counterflex.evaluate.surface import SurfaceDeviation
from counterflex.evaluate.turned_surface import TurnedDeviation

TruthLevel = Literal["catalogue", "identified", "exact"]
"""What the planner knew of the simulated cell, see :data:`TRUTH_LEVELS`."""
TRUTH_LEVELS: Final[dict[TruthLevel, str]] = {
    "catalogue": "what is published of this robot and material",
    "identified": "parameters identified on the simulated cell",
    "exact": "the exact parameters of the simulated cell",
}
"""The levels in the order of growing knowledge, each with what the planner knows at it."""


FORMAT: Final = "counterflex-summary"
VERSION: Final = 2
_FIGURES = ("max_mm", "p997_mm", "rms_mm")
_PARTS = ("path", "entry", "exit", "plateau", "air", "along", "surface", "floor", "wall")


@dataclass(frozen=True)
class Variant:
    """One machining of one part."""

    path: PathFigures  # figures of the tool path
    # deviation of the machined surface, or None where the part was not simulated
    surface: SurfaceDeviation | TurnedDeviation | None = None
    peak_force_n: float | None = None  # largest magnitude of the mean process force over one spindle turn, N, or None

    def summary(self) -> dict[str, Any]:
        """Figures of one machining in mm, every figure with its unit in the key."""
        figures = self.path
        out: dict[str, Any] = {
            name: _mm(getattr(figures, name)) for name in ("path", "entry", "exit", "plateau", "air", "along")
        }
        out["path"]["at_p_mm"] = _round(figures.at_p_m / MM)
        if self.surface is not None:
            result = self.surface
            for name in ("surface", "floor", "wall"):
                out[name] = _mm(getattr(result, name), area=True)
            out["surface"]["floor_resolution_mm"] = _round(result.floor_resolution_m / MM)
            out["surface"]["wall_resolution_mm"] = _round(result.wall_resolution_m / MM)
            out["surface"]["wall_lost_mm2"] = _round(result.wall_lost_m2 / MM**2)
        if self.peak_force_n is not None:
            out["peak_force_n"] = _round(self.peak_force_n)
        return out


@dataclass(frozen=True)
class SeedResult:
    """The same program on the same truth, uncompensated and compensated."""

    seed: int | None  # of the truth, None for a truth that agrees with the cell file
    truth_level: TruthLevel  # what the planner knew of the simulated cell
    # by name: `nominal` and `compensated`; or their figures as variant_summary gives them
    variants: Mapping[str, Variant | Mapping[str, Any]] = field(default_factory=dict)


def summary(results: Sequence[SeedResult], about: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Collect the results of a job.

    ``variants`` and ``reduction`` are those of the first result; ``seeds`` holds all of them, ``over_seeds`` the
    median and worst share that remains, ``compensated / nominal``, per truth level.

    Args:
        results: At least one.
        about: Further entries for the top level (program, cell, timing, versions); plain JSON values.

    Raises:
        InputError: No results, or an entry of ``about`` would hide one of the summary's own.
    """
    if not results:
        raise InputError("a summary needs at least one result")
    seeds = []
    for result in results:
        variants = {
            name: variant.summary() if isinstance(variant, Variant) else dict(variant)
            for name, variant in result.variants.items()
        }
        seeds.append(
            {
                "seed": result.seed,
                "truth_level": result.truth_level,
                "variants": variants,
                "reduction": _reductions(variants),
            }
        )
    out: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "truth_level": seeds[0]["truth_level"],
        "variants": seeds[0]["variants"],
        "reduction": seeds[0]["reduction"],
        "seeds": seeds,
        "over_seeds": _over_seeds(seeds),
    }
    for key, value in (about or {}).items():
        if key in out:
            raise InputError("an entry would hide one of the summary's own", value=key)
        out[key] = value
    return out


def check_summary(data: object, where: str | None = None) -> dict[str, Any]:
    """Return ``data`` as a summary of this version.

    Raises:
        FileFormatError: It is no summary, is newer than this program, or misses its figures.
    """
    if not isinstance(data, dict) or data.get("format") != FORMAT:
        raise FileFormatError("not a counterflex summary", where=where, hint=f'Its "format" must be "{FORMAT}"')
    version = data.get("version")
    if not isinstance(version, int) or version > VERSION or version < 1:
        raise FileFormatError("summary was written by another version", where=where, value=version, limit=VERSION)
    variants = data.get("variants")
    if not isinstance(variants, dict) or not isinstance(data.get("seeds"), list):
        raise FileFormatError("summary holds no variants or no seeds", where=where)
    for name, variant in variants.items():
        path = variant.get("path") if isinstance(variant, dict) else None
        for figure in _FIGURES:
            value = path.get(figure) if isinstance(path, dict) else None
            if not isinstance(value, int | float) or not math.isfinite(value) or value < 0.0:
                raise FileFormatError(
                    "summary misses a figure", where=where, value=f"variants.{name}.path.{figure} = {value!r}"
                )
    return data


def table_rows(data: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Rows of the result table: figure, nominal, compensated (mm), reduction; for the terminal or a page."""
    variants = data["variants"]
    rows = []
    for part in _PARTS:
        for figure in _FIGURES:
            values = [variants.get(name, {}).get(part, {}).get(figure) for name in ("nominal", "compensated")]
            if all(value is None for value in values):
                continue
            share = data["reduction"].get(part, {}).get(figure)
            rows.append(
                (
                    f"{part}.{figure}",
                    *("-" if value is None else f"{value:.3f}" for value in values),
                    "-" if share is None else f"{100.0 * share:.0f} %",
                )
            )
    return rows  # type: ignore[return-value]


def seed_rows(data: Mapping[str, Any]) -> list[tuple[str, str, str, str, str, str]]:
    """Rows per seed: seed, truth level, path.p997 nominal and compensated (mm), what remains of p997 and of max."""
    rows = []
    for seed in data["seeds"]:
        variants, share = seed["variants"], seed["reduction"].get("path", {})
        rows.append(
            (
                "none" if seed["seed"] is None else str(seed["seed"]),
                str(seed["truth_level"]),
                *(
                    f"{variants[name]['path']['p997_mm']:.3f}" if name in variants else "-"
                    for name in ("nominal", "compensated")
                ),
                *(
                    "-" if share.get(figure) is None else f"{100.0 * (1.0 - share[figure]):.1f} %"
                    for figure in ("p997_mm", "max_mm")
                ),
            )
        )
    return rows  # type: ignore[return-value]


def _reductions(variants: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, float | None]]:
    if "nominal" not in variants or "compensated" not in variants:
        return {}
    before, after = variants["nominal"], variants["compensated"]
    out: dict[str, dict[str, float | None]] = {}
    for part in _PARTS:
        if part in before and part in after:
            share = {name: reduction(after[part][name], before[part][name]) for name in _FIGURES}
            out[part] = {name: None if value is None else round(value, 4) for name, value in share.items()}
    return out


def _over_seeds(seeds: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    out: dict[str, Any] = {}
    for level in sorted({seed["truth_level"] for seed in seeds}):
        these = [seed["reduction"] for seed in seeds if seed["truth_level"] == level]
        entry: dict[str, Any] = {"count": len(these)}
        for part in ("path", "entry", "exit", "surface"):
            for figure in _FIGURES:
                remains = [1.0 - one[part][figure] for one in these if part in one and one[part][figure] is not None]
                if remains:
                    entry.setdefault(part, {})[figure.removesuffix("_mm")] = {
                        "median_remaining": round(statistics.median(remains), 4),
                        "worst_remaining": round(max(remains), 4),
                    }
        out[level] = entry
    return out


def _mm(figures: DeviationFigures, *, area: bool = False) -> dict[str, float]:
    extent = {"area_mm2": _round(figures.extent / MM**2)} if area else {"length_mm": _round(figures.extent / MM)}
    return {
        "max_mm": _round(figures.max_m / MM),
        "p997_mm": _round(figures.p997_m / MM),
        "rms_mm": _round(figures.rms_m / MM),
        **extent,
    }


def _round(value: float) -> float:
    """Six decimals: 1 nm where the unit is mm, far below what any figure means."""
    return round(float(value), 6)
