"""Steady pieces of cuts: what the cutting recipe fits, one row each."""

from __future__ import annotations

from dataclasses import dataclass, fields

from counterflex.core.arrays import Bool, Float, Int


@dataclass(frozen=True, eq=False)
class Pieces:
    """Mean forces of steady pieces of cuts, in the feed frame."""

    force: Float  # (n, 3) N on the tool: along the feed, to its left, up
    sigma: Float  # (n, 3) N standard deviation of these means
    depth_m: Float  # (n,) axial depth: measured where `measured`, else commanded
    depth_sigma_m: Float  # (n,) its standard deviation where measured, else 0
    measured: Bool  # (n,) whether the depth was measured
    left_m: Float  # (n,) left bound of the engaged strip from the tool axis, commanded, R at the cutter's edge
    right_m: Float  # (n,) right bound, -R at the cutter's edge
    left_wall: Bool  # (n,) whether the left bound is the work's edge (down-milling), which does not move with the tool
    right_wall: Bool  # (n,) whether the right bound is (up-milling)
    feed_tooth_m: Float  # (n,) horizontal feed per tooth
    drop_tooth_m: Float  # (n,) descent per tooth; of the measured floor where the depth was measured
    drop_sigma_m: Float  # (n,) its standard deviation
    give_m: Float  # (n, 3) displacement of the tool under the measured force by the elastic model; 0 where unknown
    elastic: Bool  # (n,) whether it is known
    axes: Float  # (n, 3, 3) from the axes that the force was given in to the feed frame
    # (n,) amplitude of the force across the tool axis once per turn, NaN where the record does not show it
    turn_n: Float
    cut: Int  # (n,) id of the cut, over all datasets
    blank: Int  # (n,) index of the blank
    run_m: Float  # (n,) length that the tool had cut before
    session: Int  # (n,) index of the dataset
    place: Int  # (n,) index into the places of steady_cuts.pieces_of, for messages

    def __len__(self) -> int:
        """Number of pieces."""
        return len(self.cut)

    def subset(self, rows: Bool) -> Pieces:
        """The marked pieces."""
        return Pieces(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})
