"""Side cuts along a straight wall: their arcs, and the mean wrench that each force constant makes of them.

A wall has a normal n that points out of the material, towards the tool. In up-milling the wall lies to the left of the
feed and the arc of engagement runs from 0 to phi; in down-milling it lies to the right, and the arc from pi - phi to
pi. With the cutter's radius R and the radial width of cut a_e, ``cos phi = 1 - a_e / R``. In the feed frame (x along
the feed, y to its left, z along the tool axis) the normal is -y in up-milling and +y in down-milling, so the same wall
is passed in opposite directions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from counterflex.core.arrays import Bool, Float, as_float
from counterflex.core.errors import InputError
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force import engagement_of_arc
from counterflex.cutting.mean_force import mean_force_weights, mean_wrenches

BINS: Final = 512
"""Of the immersion angle: a thin cut has few of the usual 64."""
_ANGLES: Final = 60
"""Positions of the spindle within one tooth pitch at which the force is looked at."""


@dataclass(frozen=True, eq=False)
class SideCuts:
    """Cuts along a wall with one cutter; n of them.

    Raises:
        InputError: A number is out of range.
    """

    cutter: Cutter
    up: Bool  # (n,) True for up-milling
    ae_m: Float  # (n,) radial width of cut, m, above 0 and at most the diameter
    ap_m: Float  # (n,) axial depth, m
    fz_m: Float  # (n,) feed per tooth, m

    def __post_init__(self) -> None:
        """Check ranges."""
        n = len(self.up)
        for name, most in (
            ("ae_m", self.cutter.diameter_m),
            ("ap_m", self.cutter.flute_length_m),
            ("fz_m", self.cutter.radius_m),
        ):
            values = as_float(name, getattr(self, name), (n,))
            if n and not (float(values.min()) > 0.0 and float(values.max()) <= most * (1.0 + 1e-12)):
                raise InputError(
                    f"side cut: {name} is out of range",
                    value=(float(values.min()), float(values.max())),
                    limit=f"above 0, at most {most:g} m",
                )

    def __len__(self) -> int:
        """Number of cuts."""
        return len(self.up)

    def some(self, rows: Bool | slice | list[int]) -> SideCuts:
        """Some of the cuts."""
        return replace(self, up=self.up[rows], ae_m=self.ae_m[rows], ap_m=self.ap_m[rows], fz_m=self.fz_m[rows])

    @property
    def immersion_rad(self) -> Float:
        """(n,) angle of the arc, ``acos(1 - a_e / R)``."""
        out: Float = np.arccos(np.clip(1.0 - self.ae_m / self.cutter.radius_m, -1.0, 1.0))
        return out

    @property
    def entry_rad(self) -> Float:
        """(n,) immersion angle at which an edge enters."""
        return np.where(self.up, 0.0, math.pi - self.immersion_rad)

    @property
    def exit_rad(self) -> Float:
        """(n,) immersion angle at which an edge leaves."""
        return np.where(self.up, self.immersion_rad, math.pi)

    @property
    def mean_chip_m(self) -> Float:
        """(n,) mean chip thickness over the arc, ``f_z (1 - cos phi) / phi`` (Berger2013 eq. 3)."""
        out: Float = self.fz_m * self.ae_m / self.cutter.radius_m / self.immersion_rad
        return out


def wrenches(cuts: SideCuts, law: ForceLaw) -> Float:
    """Mean wrench of each cut over a revolution, by the constants that make it.

    Returns:
        (n, 3, 6) N, N m on the tool about its tip, feed frame: the parts of the cutting, radial and axial constants;
        their sum over the second axis is the whole.
    """
    weights = mean_force_weights(cuts.cutter, law, BINS)
    out = np.empty((len(cuts), 3, 6))
    depths: dict[tuple[float, float, bool], Float] = {}
    booked = np.empty((len(cuts), weights.n_levels, BINS))
    for i, (ap, ae, up) in enumerate(zip(cuts.ap_m.tolist(), cuts.ae_m.tolist(), cuts.up.tolist(), strict=True)):
        if (ap, ae, up) not in depths:
            depths[ap, ae, up] = engagement_of_arc(
                cuts.cutter, ap, float(cuts.entry_rad[i]), float(cuts.exit_rad[i]), BINS
            )
        booked[i] = depths[ap, ae, up]
    for constant in range(3):
        terms = weights.terms.copy()
        terms[:, [1 + other for other in range(3) if other != constant]] = 0.0
        out[:, constant] = mean_wrenches(replace(weights, terms=terms), booked, cuts.fz_m)
    return out


def feed_axes(up: Bool, normal_part: Float) -> Float:
    """Axes of the feed frame along a wall, in part axes.

    Args:
        up: (n,) True for up-milling.
        normal_part: (3,) unit normal of the wall, horizontal, out of the material.

    Returns:
        (n, 3, 3): columns are the directions of x (feed), y (its left) and z (tool axis).
    """
    z = np.array([0.0, 0.0, 1.0])
    y = np.where(up[:, None], -normal_part, normal_part)
    out: Float = np.stack([np.cross(y, z), y, np.broadcast_to(z, y.shape)], axis=2)
    return out


def in_part(cuts: SideCuts, wrench_feed: Float, normal_part: Float) -> Float:
    """Wrenches (n, k, 6) of the feed frame in part axes."""
    axes = feed_axes(cuts.up, normal_part)[:, None]
    halves = wrench_feed.reshape(*wrench_feed.shape[:2], 2, 3)
    out: Float = (axes[:, :, None] @ halves[..., None])[..., 0].reshape(wrench_feed.shape)
    return out


def peak_side_force(cuts: SideCuts, law: ForceLaw) -> Float:
    """(n,) N, largest force square to the tool axis within a revolution, of teeth without helix.

    A helix spreads the engagement of a tooth over time, so this is an upper bound; without runout.
    """
    pitch = 2.0 * math.pi / cuts.cutter.flutes
    spindle = (np.arange(_ANGLES) + 0.5) / _ANGLES * pitch
    phi = spindle[:, None] + pitch * np.arange(cuts.cutter.flutes)  # (angles, teeth)
    phi = np.where(phi > 2.0 * math.pi, phi - 2.0 * math.pi, phi)
    sine, cosine = np.sin(phi), np.cos(phi)
    out = np.empty(len(cuts))
    for i in range(len(cuts)):
        engaged = (phi > cuts.entry_rad[i]) & (phi < cuts.exit_rad[i])
        h = np.where(engaged, cuts.fz_m[i] * np.clip(sine, 0.0, None), 0.0)
        fc = sum(k * h**p for p, k, _, _ in law.terms()) * engaged
        fr = sum(k * h**p for p, _, k, _ in law.terms()) * engaged
        x, y = (-fc * cosine - fr * sine).sum(axis=1), (fc * sine - fr * cosine).sum(axis=1)
        out[i] = cuts.ap_m[i] * float(np.hypot(x, y).max())
    return out
