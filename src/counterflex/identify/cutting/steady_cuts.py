"""Test cuts as mean forces under steady conditions: what the cutting recipe fits.

A dataset of kind ``slots`` is either a record over time, whose settled stretches are found here, or one row of means
per cut. Forces are turned into the feed frame: x along the horizontal feed, y to its left, z up along the tool axis,
force on the tool. Where the record holds the joint angles, the cell's elastic model says how far the tool yielded
under the measured force, which changes depth and width of the cut.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.errors import FileFormatError, InputError, ModelError
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.identify.cutting import cut_rows
from counterflex.identify.cutting.considered import fast_enough, turn_amplitude
from counterflex.identify.cutting.cut_rows import Pieces
from counterflex.identify.cutting.record import Zero, contact, mean_with_sigma, settled, slope, split_ramp, zero
from counterflex.identify.data.dataset import Dataset
from counterflex.identify.data.model import CellModel
from counterflex.robot.elasticity.compliance import cartesian_compliance

_RAMP_SHARE = 0.15
_GAP = 3.0
"""Periods of a record beyond which it has a gap."""


@dataclass(frozen=True)
class Cutting:
    """Settings by which settled parts are found."""

    trim_diameters: float = 1.0  # distance left out beside entries, exits and steps, in cutter diameters
    settle_s: float = 0.2  # time left out there in addition


@dataclass(frozen=True, eq=False)
class SteadyCuts:
    """Pieces of all datasets, with what they were found from."""

    pieces: Pieces
    cutter: Cutter  # the one cutter of all of them
    tool: int
    blanks: tuple[str, ...]  # names of the blanks
    places: tuple[str, ...]  # where each piece stands in the data, for messages
    remarks: tuple[str, ...]  # what a reader should know
    force: str


def pieces_of(
    cell: CellModel, data: Sequence[Dataset], options: Cutting | None = None, tool: int | None = None
) -> SteadyCuts:
    """Find the settled pieces of all test cuts.

    ``data``: Datasets of kind ``slots``.

    Raises:
        FileFormatError: A channel is missing, or has no standard deviation.
        InputError: Several tools, no settled piece, or numbers out of range.
        ModelError: The spindle turned backwards (M4).
    """
    options = Cutting() if options is None else options
    chosen = cut_rows.chosen_tool(data, tool)
    cutter = cell.cutter_of(chosen)
    rows: list[dict[str, object]] = []
    places: list[str] = []
    remarks: list[str] = []
    blanks: list[str] = []
    used, run = "", 0.0
    air = cut_rows.zero_in_air(data)
    for session, dataset in enumerate(data):
        dataset = dataset.rows(np.array(cut_rows.tools_of(dataset) == chosen, dtype=np.bool_))
        if len(dataset) == 0 or cut_rows.in_air(dataset):
            continue
        reader = _Reader(cell, cutter, dataset, options, run, air)
        used = reader.force_name
        for piece, place, blank in reader.pieces():
            name = f"{session}:{blank}"
            if name not in blanks:
                blanks.append(name)
            piece.update(session=session, blank=blanks.index(name), place=len(places))
            piece["cut"] = 1_000_000 * session + int(piece["cut"])  # type: ignore[call-overload]
            places.append(place)
            rows.append(piece)
        remarks += reader.remarks
        run = reader.run_m
    if not rows:
        raise InputError(
            "no settled piece of a cut was found",
            where=", ".join(d.where or d.name for d in data),
            hint="Cut longer than three tool diameters, or set trim_diameters and settle_s lower",
        )
    pieces = Pieces(**{f.name: np.array([row[f.name] for row in rows]) for f in fields(Pieces)})
    return SteadyCuts(pieces, cutter, chosen, tuple(blanks), tuple(places), tuple(dict.fromkeys(remarks)), used)


class _Reader:
    """One dataset, piece by piece."""

    def __init__(
        self,
        cell: CellModel,
        cutter: Cutter,
        dataset: Dataset,
        options: Cutting,
        run_m: float,
        air: tuple[Float, Float] | None = None,
    ) -> None:
        self.run_m, self.air = run_m, air
        self.cell, self.cutter, self.dataset, self.options = cell, cutter, dataset, options
        self.remarks: list[str] = []
        self.force_name = cut_rows.force_of(dataset)
        self.wrench = dataset.values(self.force_name)
        self.series = dataset.has("time_s")
        self.sigma = dataset.channel(self.force_name).sigma
        if not self.series:
            self.sigma = dataset.channel(self.force_name).need_sigma()
        self.direction = dataset.values("feed_direction")
        self.feed = self._scalar("feed_rate")
        self.spindle = self._scalar("spindle_speed")
        self.depth = self._scalar("depth")
        self.width = self._scalar("width") if dataset.has("width") else np.full(len(dataset), cutter.diameter_m)
        self.blank = self._scalar("blank") if dataset.has("blank") else np.zeros(len(dataset))
        self.gauge = dataset.channel("depth_measured") if dataset.has("depth_measured") else None
        self.q = dataset.values("q") if dataset.has("q") else None
        if self.q is None:
            self.remarks.append(
                "Without the joint angles (channel q) the elastic model cannot compute the deflection of the tool: "
                "depth and width are taken as commanded"
            )
        self._check()

    def _scalar(self, name: str) -> Float:
        return self.dataset.values(name)[:, 0]

    def _check(self) -> None:
        where = self.dataset.where or self.dataset.name
        cutting = self.depth > 0.0
        if not np.any(cutting):
            raise InputError("no row has a depth of cut above zero", where=where)
        if np.any(self.spindle[cutting] < 0.0):
            raise ModelError("the force model is that of a spindle turning clockwise (M3)", where=where, value="M4")
        for name, values in (("feed_rate", self.feed), ("spindle_speed", self.spindle)):
            if np.any(values[cutting] <= 0.0):
                row = int(np.flatnonzero(cutting & (values <= 0.0))[0])
                raise InputError(f"{name} is not above zero while cutting", where=self.dataset.place(row))
        flat = np.linalg.norm(self.direction[cutting][:, :2], axis=1)
        if np.any(flat < 0.5):
            row = int(np.flatnonzero(cutting)[int(np.argmin(flat))])
            raise InputError(
                "the feed direction of a test cut is not horizontal in part axes",
                where=self.dataset.place(row),
                value=np.round(self.direction[row], 3).tolist(),
                hint="Test cuts run level or as ramps; give feed_direction as a unit vector in part axes",
            )
        if np.any(self.width[cutting] == 0.0):
            raise InputError("width of cut is zero", where=where, hint="Give the tool diameter for a slot")
        if float(self.cutter.flute_length_m) < float(np.max(self.depth)):
            raise InputError(
                "a test cut is deeper than the flutes are long",
                where=where,
                value=f"{np.max(self.depth) / MM:.2f} mm",
                limit=f"{self.cutter.flute_length_m / MM:.2f} mm",
                hint="Is the depth in mm where m was meant?",
            )
        if self.dataset.has("feed_direction") and self.dataset.channel("feed_direction").values.shape[1] != 3:
            raise FileFormatError("feed_direction needs three components", where=where)

    def pieces(self) -> list[tuple[dict[str, object], str, int]]:
        """Pieces with the place and the blank of each."""
        if not self.series:
            rows = np.flatnonzero(self.depth > 0.0)
            sigma = self.dataset.channel(self.force_name).need_sigma()
            level = (0.0, SLOPE_SIGMA)
            return [
                (
                    self._piece(rows[i : i + 1], self.wrench[row], sigma[row], level, 0.0),
                    self.dataset.place(int(row)),
                    int(self.blank[row]),
                )
                for i, row in enumerate(rows)
            ]
        return self._from_series()

    @cached_property
    def cut_of(self) -> Int:
        """(rows,) id of the cut: the group, or where rows of a record have none, its stretches of equal conditions."""
        if not self.series or not cut_rows.ungrouped(self.dataset):
            return self.dataset.group
        state = np.column_stack([self.feed, self.spindle, self.width, self.direction, self.depth, self.blank])
        _, number = np.unique(state, axis=0, return_inverse=True)
        return np.asarray(number, dtype=np.int64).reshape(-1)

    def _from_series(self) -> list[tuple[dict[str, object], str, int]]:
        time_all = self._scalar("time_s")
        out: list[tuple[dict[str, object], str, int]] = []
        bare = middles = 0
        for cut, rows in cut_rows.cuts_of(self.dataset):
            time = time_all[rows]
            conditions = np.column_stack(
                [self.feed[rows], self.spindle[rows], self.width[rows], self.direction[rows], self.blank[rows]]
            )
            touching = contact(
                self.wrench[rows, :3],
                self.depth[rows],
                cut_rows.rows_per_turn(time, self.spindle[rows]),
                steady=bool(np.all(conditions == conditions[0])),
                air=cut_rows.has_air(self.dataset),
            )
            base = zero(self.wrench[rows], time, touching)
            if base.sides == 0 and self.air is not None:
                base = Zero(np.tile(self.air[0], (len(rows), 1)), self.air[1], 1, np.zeros(len(self.air[0])))
            bare += base.sides == 0
            shown = self.wrench[rows] - base.value
            step = np.diff(time, prepend=time[0])
            gap = np.array(step > _GAP * np.median(step), dtype=np.bool_)
            middle = bool(np.all(touching) and np.all(self.depth[rows] > 0.0))
            middles += middle
            travel = np.cumsum(self.feed[rows] * step)
            # The middle of a cut has no entry: a step of the feed settles in time, not over the tool's diameter.
            entry_m = 0.0 if middle else self.options.trim_diameters * self.cutter.diameter_m
            trim = entry_m + self.options.settle_s * self.feed[rows]
            begin = len(out)
            for stretch in settled(touching, travel, self.depth[rows], conditions, trim, gap if middle else None):
                most = _RAMP_SHARE * float(np.max(self.depth[rows]))
                for part in split_ramp(stretch, self.depth[rows], most):
                    if len(part) < AT_LEAST:
                        continue
                    stated = None if self.sigma is None else self.sigma[rows[part]]
                    mean, sigma = mean_with_sigma(shown[part], stated)
                    sigma = np.hypot(sigma, base.sigma)
                    floor = self.depth[rows[part]] if self.gauge is None else self.gauge.values[rows[part], 0]
                    steepness = slope(travel[part], floor)
                    span = float(np.ptp(travel[part]))
                    before = self.run_m + float(np.sum(np.diff(travel[: part[0] + 1]) * touching[1 : part[0] + 1]))
                    piece = self._piece(rows[part], mean, sigma, (steepness, self._slope_sigma(span)), before)
                    piece["turn_n"] = self._once_per_turn(shown[part], time[part], float(self.spindle[rows[part[0]]]))
                    out.append((piece, self.dataset.place(int(rows[part[0]])), int(self.blank[rows[part[0]]])))
            self.run_m += float(np.sum(np.diff(travel) * touching[1:]))
            if len(out) == begin:
                self.remarks.append(f"Cut {cut} has no settled stretch and is not used")
        if bare:
            self.remarks.append(
                f"{bare} cuts have no rows in air before or after them: the force channel is taken as free of zero. An "
                "unknown zero counts as edge force: give a record in air (depth 0 in all rows) as a further file"
            )
        if middles:
            self.remarks.append(
                f"{middles} cuts have no entry and no exit in their record: they are taken as middles of cuts, and "
                "nothing is left out at their ends"
            )
        return out

    def _once_per_turn(self, shown: Float, time: Float, spindle: float) -> float:
        """Amplitude once per turn across the tool axis, NaN where record or sensor do not show single teeth."""
        flutes = self.cutter.flutes
        band = float(self.dataset.settings.get("bandwidth_hz", 0.0))
        # A sensor that damps the tooth passing shows too small an amplitude, which would be read as no runout.
        if band < spindle / (2.0 * np.pi) * flutes or not fast_enough(time, spindle, flutes):
            return float("nan")
        in_part = np.eye(3) if self.force_name == "f_tcp_part" else self.cell.T_base_part[:3, :3].T
        return turn_amplitude((shown[:, :3] @ in_part.T)[:, :2], time, spindle, flutes)

    def _slope_sigma(self, span_m: float) -> float:
        if self.gauge is None:
            return SLOPE_SIGMA
        return min(SLOPE_SIGMA, float(np.sqrt(2.0) * np.median(self.gauge.need_sigma()) / max(span_m, 1e-9)))

    def _piece(
        self, rows: Int, wrench: Float, sigma: Float, slope: tuple[float, float], run: float
    ) -> dict[str, object]:
        R = self._feed_axes(int(rows[0]))
        T = self.cell.T_base_part[:3, :3]
        in_part = np.eye(3) if self.force_name == "f_tcp_part" else T.T
        force = R @ in_part @ wrench[:3]
        spread = np.sqrt((R @ in_part) ** 2 @ sigma[:3] ** 2)
        give = np.zeros(3)
        if self.q is not None:
            load = np.zeros(6)
            load[:3] = T @ R.T @ force
            if len(wrench) == 6:
                load[3:] = wrench[3:]
            C = cartesian_compliance(self.cell.chain, self.q[rows].mean(axis=0))
            give = R @ T.T @ (C @ load)[:3]
        first = int(rows[0])
        radius, width = self.cutter.radius_m, float(self.width[first])
        slot = abs(width) >= 2.0 * radius * (1.0 - 1e-9)
        teeth = float(self.spindle[first]) / (2.0 * np.pi) * self.cutter.flutes
        level = float(np.hypot(self.direction[first, 0], self.direction[first, 1]))
        feed = float(self.feed[first]) * level / teeth
        measured = self.gauge is not None
        depth = float(self.gauge.values[rows, 0].mean()) if self.gauge is not None else float(self.depth[rows].mean())
        return {
            "force": force,
            "sigma": spread,
            "depth_m": depth,
            "depth_sigma_m": float(self.gauge.need_sigma()[first, 0]) if self.gauge is not None else 0.0,
            "measured": measured,
            "left_m": radius if slot or width > 0.0 else -radius - width,
            "right_m": -radius if slot or width < 0.0 else radius - width,
            "left_wall": not slot and width < 0.0,
            "right_wall": not slot and width > 0.0,
            "feed_tooth_m": feed,
            "drop_tooth_m": slope[0] * feed,
            "drop_sigma_m": slope[1] * feed,
            "give_m": give,
            "elastic": self.q is not None,
            "axes": R @ in_part,
            "turn_n": np.nan,
            "cut": int(self.cut_of[first]),
            "run_m": run,
        }

    def _feed_axes(self, row: int) -> Float:
        """(3, 3): rows are the axes along, left, up in part axes."""
        x, y = self.direction[row, :2] / np.hypot(*self.direction[row, :2])
        return np.array([[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]])


SLOPE_SIGMA = 1e-3
"""Standard deviation of the slope of a slot's floor that nobody measured: the robot yields differently along it."""
AT_LEAST = 4
"""Fewest rows of a record that make a piece."""
