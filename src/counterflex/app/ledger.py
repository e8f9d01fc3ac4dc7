"""Predict, commit, reveal: figures with intervals in a sealed file, and the measurement that came later.

The seal is a SHA-256 over figures, program, cell, version and time. Whoever keeps it (a commit, a message) sees a later
change. A ledger leaves nothing out: it lists misses, and predictions that nobody has revealed.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from counterflex import __version__
from counterflex.app.robot_programs import digest
from counterflex.core import build_data, file_content
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.result import Parts, ShownTable, Summary
from counterflex.core.units import MM
from counterflex.files.dataset.reader import read_dataset
from counterflex.files.summary_file import SEAL, SUMMARY, read_sealed, read_summary, require_whole, write_sealed

PREDICTION: Final = "counterflex-prediction"
PAIR: Final = "counterflex-pair"
_VARIANTS: Final = {"before": "nominal", "after": "compensated"}
_OTHER: Final = {
    "machined_sha256": "Predict the plan of the program that was run: prove machines the one of compensate without --as"
}
"""Hints where a digest differs."""
_INPUTS: Final = {"program_sha256": "program", "cell_sha256": "cell file", "machined_sha256": "machined program"}
_NO_TIME: Final = "when it was measured, which the measurement does not say"
INDEPENDENCE: Final = {
    "mild": "constants drawn apart from the planner, which reads none; the same kinds of physics, the same authors",
    "wide": "as mild, farther from the cell file",
    "other": "kinds of physics that the planner has no model of; the same authors",
    "scan": "a simulated cell whose constants the planner does not read, and its simulated scan",
    "part": "measured by whoever reveals",
    "pulls": "measured by whoever reveals; whether the model was made with these data is not known",
}
"""By family of a simulated cell or kind of measurement: how far it is from what made the prediction."""


class _Measured(NamedTuple):
    against: str
    kind: str  # Key of INDEPENDENCE, or another family
    inputs: Mapping[str, str]  # Digests and time that the measurement states
    figures: Mapping[str, Mapping[str, float]]  # By truth
    not_looked_at: tuple[str, ...] = ()


_INTERVAL: Final = "predicted:g | 90 % interval={low:g} to {high:g}~none"
_INSIDE: Final = {None: "no interval", True: "yes", False: "no"}


class SealedPrediction(Summary):
    """Figures that are predicted, sealed."""

    def _shown(self) -> Parts:
        rows = [one | {"figure": name} for name, one in self["figures"].items()]
        yield ShownTable.of(self.line("{program} on {cell}"), f"figure | {_INTERVAL}", rows)


class RevealedPair(Summary):
    """A prediction and what came."""

    def _shown(self) -> Parts:
        yield _compared(self.line("{prediction[program]}, against {against}"), self["figures"])
        yield from self.each("not_looked_at", "not looked at: {}")


class Ledger(Summary):
    """Every pair of a folder, and predictions that nobody has revealed."""

    def _shown(self) -> Parts:
        yield _compared("Every pair", self["rows"], "program | against | ")
        title = "Credibility: what was validated, against what, how independent"
        yield self.rows("credibility", title, "figure | against | inside | of | above | independence")
        yield from self.each("not_revealed", "not revealed: {}")


def _compared(title: str, rows: list[dict[str, Any]], more: str = "") -> ShownTable:
    shown = [row | {"inside": _INSIDE[row["inside"]]} for row in rows]
    return ShownTable.of(title, f"{more}truth | figure | {_INTERVAL} | came:g | inside", shown)


def predict(source: Path, cell_file: Path | None, out: Path) -> SealedPrediction:
    """Write what a plan predicts, or a cell under the loads of pulls.

    Args:
        source: Folder of ``compensate`` or ``correct``; with ``cell_file`` a manifest of pulls.
        out: New file: a prediction is never replaced.

    Raises:
        CounterflexError: The source has no interval, does not say of what it is, or ``out`` exists.
    """
    _require_new(out)
    if source.is_dir() != (cell_file is None):
        raise InputError("a folder of a plan has its own cell, a manifest of pulls needs --cell", where=str(source))
    about = _of_plan(source) if cell_file is None else _of_pulls(source, cell_file)
    made = {"created": _now(), "counterflex": __version__, "commit": build_data.commit(), "interval": 0.9}
    write_sealed(out, PREDICTION, made | about)
    return SealedPrediction(read_sealed(out, PREDICTION))


def reveal(prediction: Path, measured: Path, out: Path | None) -> RevealedPair:
    """Compare a prediction with the measurement that came later.

    Args:
        measured: Folder of ``evaluate``, ``prove``, ``inspect`` or ``correct``; of pulls their manifest.
        out: New file of the pair, or None.

    Raises:
        CounterflexError: The prediction was changed, or the measurement is older, or of another program or cell.
    """
    if out is not None:
        _require_new(out)
    sealed = read_sealed(prediction, PREDICTION)
    measurement = _of_data(measured) if measured.is_file() else _of_summary(measured)
    _require_same(sealed, measurement, measured)
    rows = [
        {"truth": truth, "figure": name, **one, "came": values[name], "inside": _is_inside(one, values[name])}
        for truth, values in measurement.figures.items()
        for name, one in sealed["figures"].items()
        if name in values
    ]
    if not rows:
        limit = ", ".join(sealed["figures"])
        hint = "A scan shows the surface; the path is measured by prove, evaluate, or inspect --tool-log"
        raise InputError(
            "the measurement has none of the predicted figures", where=str(measured), limit=limit, hint=hint
        )
    pair: dict[str, Any] = {
        "revealed": _now(),
        "prediction": sealed,
        "against": measurement.against,
        "independence": INDEPENDENCE.get(measurement.kind, "a truth of no family"),
    }
    pair |= {"figures": rows, "not_looked_at": list(measurement.not_looked_at)}
    if out is not None:
        write_sealed(out, PAIR, pair)
    return RevealedPair(pair)


def ledger(folder: Path) -> Ledger:
    """Return all pairs of a folder and the folders below, and predictions that were not revealed.

    Returns:
        ``rows`` (one per figure), ``credibility`` (one per figure and kind of truth), ``not_revealed`` (files).

    Raises:
        FileFormatError: A file was changed after it was written.
    """
    rows, waiting, paired = [], {}, set()
    for file in sorted(folder.rglob("*.json")):
        kind = file_content.json_value(file).get("format")
        if kind == PREDICTION:
            waiting[read_sealed(file, PREDICTION)[SEAL]] = file.name
        elif kind == PAIR:
            pair = read_sealed(file, PAIR)
            sealed = pair["prediction"]
            paired.add(sealed[SEAL])
            own = {key: sealed[key] for key in (SEAL, "program", "cell", "created")}
            rows += [own | {key: pair[key] for key in ("against", "independence")} | row for row in pair["figures"]]
    groups: dict[tuple[str, str], dict[str, Any]] = {}
    for row in rows:
        if row["inside"] is not None:
            figure = "deflection of pulls" if row["figure"].startswith("pull") else row["figure"]
            new = {"figure": figure, "against": row["against"], "inside": 0, "of": 0, "above": 0}
            group = groups.setdefault((figure, row["against"]), new | {"independence": row["independence"]})
            group["of"] += 1
            group["inside"] += row["inside"]
            group["above"] += row["came"] > row["high"]
    open_ = [name for seal, name in waiting.items() if seal not in paired]
    return Ledger(rows=rows, credibility=list(groups.values()), not_revealed=open_)


def _of_plan(folder: Path) -> dict[str, Any]:
    require_whole(folder)
    summary, figures = read_summary(folder / SUMMARY), {}
    where, job = str(folder / SUMMARY), summary.get("job")
    if "inputs" not in summary or job not in ("compensate", "correct"):
        limit = "a folder of compensate or correct of this version"
        raise FileFormatError("it does not say of which program and cell it is", where=where, limit=limit)
    if job == "correct":
        ends = (summary["correct"]["expected"][f"next_{name}_um"] for name in ("p997", "5_percent", "95_percent"))
        figures["surface.p997_mm"] = _figure(*(round(value / 1000.0, 4) for value in ends))
    elif (headline := summary["prediction"].get("headline")) is not None:
        figures = {f"{name}.p997_mm": _figure(*headline[f"{name}_mm"]) for name in _VARIANTS}
        figures["peak_force_n"] = _figure(summary["prediction"]["peak_force_n"]["value"])
    else:
        hint = "Compensate with --predict; there is none where the robot holds the part"
        raise InputError("this plan has no interval", where=where, hint=hint)
    inputs = summary["inputs"] | {"machined_sha256": digest(folder / summary["files"][0])}
    return {key: summary[key] for key in ("job", "program", "cell")} | {"inputs": inputs, "figures": figures}


def _of_pulls(manifest: Path, cell_file: Path) -> dict[str, Any]:
    """Deflection of each pull by cell file and load; what was measured is not used."""
    from counterflex.app.cut_points import CutPoints
    from counterflex.app.identification.cell_model import in_model_angles
    from counterflex.app.prediction_interval import expected_deflection
    from counterflex.files.cell.cell import read_cell
    from counterflex.identify.pulls.pulls import read_pulls

    cell, data = read_cell(cell_file), read_dataset(manifest)
    pulls, figures = read_pulls(cell.chain, in_model_angles(data, cell.robot.axes)), {}
    if np.any(pulls.p_tcp_measured):
        raise InputError("only the deflection of the tool centre point is predicted", where=str(manifest),
                         value="p_tcp_measured_m", limit="0, 0, 0")  # fmt: skip
    for k, line in enumerate(pulls.line.tolist()):
        at = CutPoints(pulls.q[k : k + 1], pulls.w_tcp_base[k : k + 1], np.zeros((1, 3)), np.ones(1), "", np.arange(1))
        ends = expected_deflection(cell, at, known="cutting")
        lengths = (ends.median_m, ends.low_m, ends.high_m)
        figures[f"pull_line_{line}_mm"] = _figure(*(round(length / MM, 4) for length in lengths))
    inputs = {"program_sha256": data.fingerprint, "cell_sha256": digest(cell_file)}
    return {"job": "pulls", "program": data.name, "cell": cell.name, "inputs": inputs, "figures": figures}


def _of_data(manifest: Path) -> _Measured:
    data = read_dataset(manifest)
    d = data.values("d_tcp_base" if data.has("d_tcp_base") else "d_tracker_target")[:, :3]
    lengths = zip(data.line.tolist(), np.linalg.norm(d, axis=1).tolist(), strict=True)
    sizes = {f"pull_line_{line}_mm": round(length / MM, 4) for line, length in lengths}
    return _Measured(f"pulls, {data.name}", "pulls", {"program_sha256": data.fingerprint}, {"": sizes}, (_NO_TIME,))


def _of_summary(folder: Path) -> _Measured:
    require_whole(folder)
    summary = read_summary(folder / SUMMARY)
    job, inputs = summary.get("job"), dict(summary.get("inputs", {}))
    if job in ("evaluate", "prove"):
        family = summary.get("family") or "no family"
        planned = [one for one in summary["seeds"] if job == "evaluate" or one["truth_level"] == "catalogue"]
        figures = {f"seed {one['seed']}": _of_variants(one["variants"]) for one in planned}
        return _Measured(f"simulated cells, {family}", family, inputs, figures)
    kind = "part"
    if job == "inspect":
        last = list(summary["parts"].values())[-1]
        values = {"surface.p997_mm": last["surface"]["p997_mm"]}
        values = {"after.p997_mm": last["path"]["path"]["p997_mm"]} if "path" in last else values
    elif job == "correct":
        part = summary["correct"]["parts"][-1]
        kind = "scan" if part.get("simulated") else kind
        values = {"surface.p997_mm": round(part["surface_p997_um"] / 1000.0, 4)}
    else:
        limit = "a folder of evaluate, prove, inspect or correct"
        raise InputError("this folder holds no measurement of a part", where=str(folder), value=job, limit=limit)
    against = {"part": "measured parts", "scan": "scans of simulated parts"}[kind]
    return _Measured(against, kind, inputs, {"": values}, ("which program made the part", _NO_TIME))


def _of_variants(variants: Mapping[str, Any]) -> dict[str, float]:
    out = {f"{name}.p997_mm": variants[key]["path"]["p997_mm"] for name, key in _VARIANTS.items() if key in variants}
    force = list(variants.values())[-1].get("peak_force_n")
    return out if force is None else out | {"peak_force_n": force}


def _require_same(sealed: Mapping[str, Any], measurement: _Measured, measured: Path) -> None:
    """Refuse a measurement of something else, or one that began before the prediction was written."""
    needed = ("program_sha256",) if measurement.kind == "pulls" else ("program_sha256", "cell_sha256")
    for key, what in _INPUTS.items():
        own, its = sealed["inputs"].get(key), measurement.inputs.get(key)
        if own != its and (key in needed or key in measurement.inputs):
            value, limit = f"SHA-256 {str(its)[:12]}", str(own)[:12]
            fault = f"the measurement is of another {what} than the prediction"
            raise InputError(fault, where=str(measured), value=value, limit=limit, hint=_OTHER.get(key))
    if _NO_TIME not in measurement.not_looked_at and measurement.inputs["begun"] < sealed["created"]:
        value, limit = measurement.inputs["begun"], f"after {sealed['created']}"
        raise InputError("the measurement is older than the prediction", where=str(measured), value=value, limit=limit)


def _figure(predicted: float, low: float | None = None, high: float | None = None) -> dict[str, float | None]:
    return {"predicted": predicted, "low": low, "high": high}


def _is_inside(sealed: Mapping[str, Any], value: float) -> bool | None:
    return None if sealed["low"] is None else bool(sealed["low"] <= value <= sealed["high"])


def _require_new(out: Path) -> None:
    if out.exists():
        raise InputError("a prediction or pair is never replaced", where=f"--out {out}", hint="Choose another --out")


def _now() -> str:
    return datetime.datetime.now(tz=datetime.UTC).isoformat(timespec="milliseconds")
