"""The cut as it feeds back on the tool: directional coefficients of an engagement.

A tool that is displaced by q against the surface that the tooth before it left (displaced by q_T) changes the chip
thickness by ``dh = n . (q - q_T)``, and with it the force by

    dF(phi) = -a(phi) (q - q_T),   a(phi) = sum_edges dz (Kt t + Kr n + Ka e) n' / sin(kappa)

in the feed frame (x along the feed, y to its left, z up the tool axis) at the immersion angle phi, clockwise from +y
as seen from the spindle, with the motion of the edge ``t = (cos, -sin, 0)``, the outward normal of the cut surface
``n = (sin sin(kappa), cos sin(kappa), -cos(kappa))`` and the direction along the edge
``e = (sin cos(kappa), cos cos(kappa), sin(kappa))``. Kt, Kr, Ka in Pa are the slopes of the force per length of edge
over the chip thickness, taken at the mean thickness of the engagement; edge forces do not feed back. The mean over a
revolution is ``A = N/2pi integral a dphi``. Helix and pitch do not change A; the time-varying a(t) is that of straight
teeth, evenly pitched.

Source: Altintas and Budak 1995; inclined edges as in :mod:`counterflex.cutting.mean_force` (Altintas and Lee 1998).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Float, as_float
from counterflex.core.errors import InputError
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter

_UPRIGHT = 1e-12
"""Cosine of an inclination that counts as 90 deg: the axial direction then drops out."""
_SAME_RAD = 1e-9
"""Ends of arcs closer together than this are one."""


@dataclass(frozen=True, eq=False)
class Process:
    """An engagement with the slopes of its force."""

    # (m, 4) rows of start angle, end angle (rad, 0 <= start < end <= pi), axial depth (m) and inclination kappa (rad,
    # 90 deg on the cylinder)
    arcs: Float
    slopes_pa: Float  # (3,) Kt, Kr, Ka
    teeth: int  # number of teeth N

    def __post_init__(self) -> None:
        """Check every number."""
        arcs = as_float("arcs", self.arcs, (None, 4))
        as_float("slopes_pa", self.slopes_pa, (3,))
        if self.teeth < 1:
            raise InputError("number of teeth is out of range", value=self.teeth, limit=">= 1")
        if np.any((arcs[:, 0] < 0.0) | (arcs[:, 1] <= arcs[:, 0]) | (arcs[:, 1] > np.pi + 1e-9)):
            raise InputError("an arc of the engagement is out of range", limit="0 <= start < end <= pi")
        if np.any(arcs[:, 2] < 0.0):
            raise InputError("axial depth is negative", value=float(arcs[:, 2].min()), limit=">= 0 m")

    def up_to(self, phi: Float) -> Float:
        """Integral of a from 0 to phi in [0, 2 pi], (..., 3, 3) N/m rad."""
        start, end, depth, kappa = self.arcs.T
        here = np.clip(np.asarray(phi)[..., None], start, end)
        parts = _primitive(here, kappa, self.slopes_pa) - _primitive(start, kappa, self.slopes_pa)
        out: Float = np.einsum("m,...mij->...ij", depth, parts)
        return out

    @property
    def mean(self) -> Float:
        """A, (3, 3) N/m: the mean over a revolution."""
        out: Float = self.teeth / (2.0 * np.pi) * self.up_to(np.array(np.pi))
        return out

    def means(self, phi: Float) -> Float:
        """Means over intervals of the tooth pitch, all teeth together, (k, 3, 3) N/m.

        Args:
            phi: (k + 1,) rad, rising from 0 to the pitch ``2 pi / N``.
        """
        pitch = 2.0 * np.pi / self.teeth
        begin = np.arange(self.teeth)[:, None] * pitch
        sums = np.diff(self.up_to(np.minimum(begin + phi, 2.0 * np.pi)), axis=1).sum(axis=0)
        out: Float = sums / np.diff(phi)[:, None, None]
        return out

    def engaged(self) -> Float:
        """(m, 2) rad, rising: stretches of the tooth pitch in which any tooth cuts; it moves freely in the others."""
        pitch = 2.0 * np.pi / self.teeth
        spans = self.arcs[self.arcs[:, 2] > 0.0, :2]
        marks = np.unique(np.concatenate([[0.0, pitch], np.mod(spans, pitch).ravel()]))
        marks = marks[np.diff(marks, prepend=-1.0) > _SAME_RAD]
        marks[-1] = pitch  # also where a mark lay just before it
        middles = 0.5 * (marks[:-1] + marks[1:]) + np.arange(self.teeth)[:, None] * pitch  # (N, stretches)
        cuts = np.any((middles[..., None] > spans[:, 0]) & (middles[..., None] < spans[:, 1]), axis=(0, 2))
        change = np.diff(np.concatenate([[0], cuts.astype(np.int64), [0]]))
        first, last = np.flatnonzero(change > 0), np.flatnonzero(change < 0)
        return np.stack([marks[first], marks[last]], axis=1)


def _primitive(phi: Float, kappa: Float, slopes: Float) -> Float:
    """Primitive of ``(Kt t + Kr n + Ka e) n' / sin(kappa)`` over phi, (..., 3, 3); phi and kappa broadcast."""
    kt, kr, ka = slopes
    S, C = np.sin(kappa), np.cos(kappa)
    C = np.where(np.abs(C) < _UPRIGHT, 0.0, C)
    half = 0.25 * np.sin(2.0 * phi)
    ss, cc, sc = 0.5 * phi - half, 0.5 * phi + half, 0.5 * np.sin(phi) ** 2
    s, c = -np.cos(phi), np.sin(phi)
    radial, upward = kr * S + ka * C, kr * C - ka * S  # along (sin, cos) and, negative, along z
    out = np.empty((*np.shape(half + S), 3, 3))
    out[..., 0, 0] = kt * sc + radial * ss
    out[..., 0, 1] = kt * cc + radial * sc
    out[..., 1, 0] = radial * sc - kt * ss
    out[..., 1, 1] = radial * cc - kt * sc
    out[..., 0, 2] = -(kt * c + radial * s) * C / S
    out[..., 1, 2] = (kt * s - radial * c) * C / S
    out[..., 2, 0] = -upward * s
    out[..., 2, 1] = -upward * c
    out[..., 2, 2] = upward * C / S * phi
    return out


def process_of_arc(
    entry_rad: float, exit_rad: float, kt_pa: float, kr_pa: float, teeth: int, depth_m: float = 1.0
) -> Process:
    """A cylindrical cutter engaged over one arc.

    Args:
        entry_rad: Immersion angle at which a tooth enters: 0 in up-milling.
        exit_rad: Where it leaves: pi in down-milling.
        kt_pa: Tangential slope Kt, Pa.
        kr_pa: Radial slope Kr, Pa.
        teeth: N.
        depth_m: Axial depth, m; 1 makes limits of depth factors of it.

    Raises:
        InputError: Angles out of order, or numbers out of range.
    """
    arcs = np.array([[entry_rad, exit_rad, depth_m, 0.5 * np.pi]])
    return Process(arcs, np.array([kt_pa, kr_pa, 0.0]), teeth)


def process_of_side_cut(
    cutter: Cutter, law: ForceLaw, entry_rad: float, exit_rad: float, depth_m: float, feed_m: float
) -> Process:
    """The process of a constant depth over one arc, the slopes taken at the mean chip thickness of its edge.

    Args:
        entry_rad: Immersion angle at which a tooth enters: 0 in up-milling.
        exit_rad: Where it leaves: pi in down-milling.
        depth_m: Axial depth above the tip, m, > 0.
        feed_m: Feed per tooth, m, > 0.

    Raises:
        InputError: Angles out of order, or numbers out of range.
    """
    # Each axial level of a corner has an inclination of its own, so each is an arc of its own.
    boundaries, kappa = cutter.levels(), cutter.level_inclinations()
    heights = np.clip(np.minimum(boundaries[1:], depth_m) - boundaries[:-1], 0.0, None)
    some = np.flatnonzero(heights > 0.0)
    if not exit_rad > entry_rad or len(some) == 0:
        raise InputError("nothing is engaged", value=(entry_rad, exit_rad, depth_m), limit="entry < exit, depth > 0 m")
    arcs = np.array([[entry_rad, exit_rad, heights[level], kappa[level]] for level in some])
    return process_of_arcs(arcs, law, feed_m, cutter.flutes)


def slopes_of(law: ForceLaw, chip_m: float) -> Float:
    """Slopes Kt, Kr, Ka of the force per length of edge over the chip thickness, (3,) Pa: ``sum_t p_t k_t h^(p_t-1)``.

    A power law has no finite slope at h = 0; the mean thickness of the engagement is the place to take it.

    Args:
        chip_m: Chip thickness, m, > 0.

    Raises:
        InputError: The thickness is not above zero.
    """
    if not chip_m > 0.0:
        raise InputError("chip thickness is out of range", value=chip_m, limit="> 0 m")
    terms = law.terms()
    p = terms[:, :1]
    out: Float = np.sum(p * terms[:, 1:] * chip_m ** (p - 1.0), axis=0)
    return out


def arcs_of_engagement(depth: Float, cutter: Cutter, least_m: float = 1e-6) -> Float:
    """Arcs of a booked engagement, (m, 4): start and end angle, axial length, inclination.

    Args:
        depth: (n_levels, n_bins) engaged axial length, m, see :mod:`counterflex.cutting.removal`.
        least_m: Bins with less engaged length are taken as empty, m.
    """
    edges = np.linspace(0.0, np.pi, depth.shape[1] + 1)
    level, at = np.nonzero(depth > least_m)
    kappa = cutter.level_inclinations()[level]
    return np.stack([edges[at], edges[at + 1], depth[level, at], kappa], axis=1)


def mean_chip_of_arcs(arcs: Float, feed_m: float) -> float:
    """Mean chip thickness over the engaged edge of arcs (m, 4), m; 0 without any."""
    width = (arcs[:, 1] - arcs[:, 0]) * arcs[:, 2]
    total = float(width.sum())
    if total <= 0.0:
        return 0.0
    sine = (np.cos(arcs[:, 0]) - np.cos(arcs[:, 1])) * arcs[:, 2] * np.sin(arcs[:, 3])
    return feed_m * float(sine.sum()) / total


def process_of_arcs(arcs: Float, law: ForceLaw, feed_m: float, teeth: int) -> Process:
    """The process of arcs of engagement, the slopes taken at the mean chip thickness of the engaged edge.

    ``arcs``: (m, 4), see :class:`Process`; ``feed_m``: feed per tooth, m, > 0; ``teeth``: number of teeth.

    Raises:
        InputError: Nothing is engaged.
    """
    if len(arcs) == 0:
        raise InputError("nothing is engaged", limit="at least one arc")
    return Process(arcs, slopes_of(law, mean_chip_of_arcs(arcs, feed_m)), teeth)
