"""Force coefficients of a cutting edge: Kienzle's power law and the linear law with an edge force.

Both laws give the force per length of engaged edge as a function of the uncut chip thickness h in three directions
of the edge: ``c`` cutting (against the edge's motion), ``r`` radial (normal to the machined surface, from the edge
into the tool), ``a`` axial (along the edge towards the tool tip). A positive ``a`` is what a right-handed helix on a
right-handed mill does: it pulls the tool out of its holder, along z of the TCP frame (Lee and Altintas 1996).

Both are sums of powers, ``F'(h) = sum_t k_t h^p_t`` with ``0 <= p_t <= 1``. :meth:`KienzleLaw.terms` and
:meth:`LinearEdgeLaw.terms` hand exactly that to the kernels, so that no kernel knows which law it integrates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import MM

H_KIENZLE_M = MM
"""Chip thickness to which the tables of k_1.1 refer: 1 mm. Leaving it out in SI gives 6.6 times the force (m 0.27)."""


Directions = tuple[float, float, float]
"""A number for each of cutting, radial and axial force."""


def _by_direction(factor: float | Directions) -> Directions:
    factors = factor if isinstance(factor, tuple) else (factor, factor, factor)
    for one in factors:
        as_positive("factor", one)
    return factors


def _finite(name: str, value: float) -> float:
    return float(as_float(name, value, ()))


def _check_range(h_min_m: float, h_max_m: float) -> None:
    as_positive("h_min_m", h_min_m, zero=True)
    as_positive("h_max_m", h_max_m)
    if h_max_m <= h_min_m:
        raise InputError("the range of chip thickness is empty", value=(h_min_m, h_max_m), limit="h_min_m < h_max_m")


def _check_cutting(name: str, value_pa: float) -> None:
    if _finite(name, value_pa) <= 0.0:
        raise InputError(
            f"{name} is not a positive specific cutting force",
            value=value_pa,
            hint="It is stored in Pa: 780 N/mm2 is 780e6",
        )


@dataclass(frozen=True)
class KienzleLaw:
    """Kienzle's law with an exponent of its own for each direction.

    ``F'_i(h) = k_i,ref h (h / h_ref)^-m_i + e_i`` in N per m of edge, i = c, r, a, with an optional edge force e that
    does not depend on h (ploughing; 0 in Kienzle's own form). The coefficients are stored at a
    reference thickness inside the range of the data: k_1.1 is an extrapolation to 1 mm, 10 to 50 times outside
    what milling tests see, and its standard error there is 20 % where that of k at h_ref is 2 %.

    Args:
        kc_ref_pa: Specific cutting force at ``h_ref_m`` in Pa, > 0.
        mc: Its exponent, 0 <= m < 1.
        kr_ref_pa: Radial coefficient at ``h_ref_m`` in Pa, positive away from the edge into the tool.
        mr: Its exponent.
        ka_ref_pa: Axial coefficient at ``h_ref_m`` in Pa, positive towards the tool tip.
        ma: Its exponent.
        h_ref_m: Reference chip thickness in m.
        h_min_m: Smallest mean chip thickness the coefficients are good for, in m.
        h_max_m: Largest one, in m.
        source: Where the numbers come from.
        status: ``measured``, ``catalogue``, ``derived``, ``assumed``, or several joined by `` + ``.
        edge_n_m: (3,) edge forces e of c, r, a in N/m.

    Raises:
        InputError: A number is outside what the law allows.

    Source: Berger2013 (eq. 1-2 corrected: the chip's area is b h), Kienzle 1952.
    """

    kc_ref_pa: float
    mc: float
    kr_ref_pa: float
    mr: float
    ka_ref_pa: float
    ma: float
    h_ref_m: float
    h_min_m: float
    h_max_m: float
    source: str
    status: str
    edge_n_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        _check_cutting("kc_ref_pa", self.kc_ref_pa)
        as_float("edge_n_m", self.edge_n_m, (3,))
        _finite("kr_ref_pa", self.kr_ref_pa)
        _finite("ka_ref_pa", self.ka_ref_pa)
        for name, exponent in (("mc", self.mc), ("mr", self.mr), ("ma", self.ma)):
            if not 0.0 <= _finite(name, exponent) < 1.0:
                raise InputError(f"Kienzle exponent {name} is out of range", value=exponent, limit="0 <= m < 1")
        as_positive("h_ref_m", self.h_ref_m)
        _check_range(self.h_min_m, self.h_max_m)

    @classmethod
    def from_k11(
        cls,
        kc11_pa: float,
        mc: float,
        *,
        kr11_pa: float,
        mr: float,
        ka11_pa: float,
        ma: float,
        h_min_m: float,
        h_max_m: float,
        source: str,
        status: str,
    ) -> KienzleLaw:
        """Build the law from table values that refer to b = h = 1 mm.

        The reference thickness becomes the geometric mean of the range, or 0.01 of ``h_max_m`` when the range starts
        at zero.

        Args:
            kc11_pa: k_c1.1 in Pa.
            mc: Its exponent.
            kr11_pa: Radial coefficient at 1 mm in Pa (k_f1.1 of a 90 deg mill).
            mr: Its exponent.
            ka11_pa: Axial coefficient at 1 mm in Pa (k_p1.1 of a 90 deg mill).
            ma: Its exponent.
            h_min_m: Smallest mean chip thickness of validity in m.
            h_max_m: Largest one in m.
            source: Where the numbers come from.
            status: How they were obtained.
        """
        _check_range(h_min_m, h_max_m)
        at_1mm = cls(
            kc_ref_pa=kc11_pa,
            mc=mc,
            kr_ref_pa=kr11_pa,
            mr=mr,
            ka_ref_pa=ka11_pa,
            ma=ma,
            h_ref_m=H_KIENZLE_M,
            h_min_m=h_min_m,
            h_max_m=h_max_m,
            source=source,
            status=status,
        )
        # A range that begins at 0 has no geometric mean.
        return at_1mm.at_reference(math.sqrt(h_min_m * h_max_m) if h_min_m > 0.0 else 0.01 * h_max_m)

    @classmethod
    def with_ratios(
        cls,
        kc11_pa: float,
        mc: float,
        *,
        kr_over_kc: float,
        ka_over_kc: float,
        h_min_m: float,
        h_max_m: float,
        source: str,
        status: str = "assumed",
    ) -> KienzleLaw:
        """Build the law from k_c1.1 and two ratios that the user assumes, all three with the exponent ``mc``.

        Ratios are an assumption: identified radial exponents of milling sets are 0.57 to 0.82 where m_c is 0.25 to
        0.5, so a ratio holds near one chip thickness only.

        Args:
            kc11_pa: k_c1.1 in Pa.
            mc: Exponent of all three directions.
            kr_over_kc: Radial over cutting coefficient.
            ka_over_kc: Axial over cutting coefficient.
            h_min_m: Smallest mean chip thickness of validity in m.
            h_max_m: Largest one in m.
            source: Where k_c1.1 and the ratios come from.
            status: How they were obtained.
        """
        return cls.from_k11(
            kc11_pa,
            mc,
            kr11_pa=kr_over_kc * kc11_pa,
            mr=mc,
            ka11_pa=ka_over_kc * kc11_pa,
            ma=mc,
            h_min_m=h_min_m,
            h_max_m=h_max_m,
            source=source,
            status=status,
        )

    def at_reference(self, h_ref_m: float) -> KienzleLaw:
        """Return the same law with its coefficients stored at another reference thickness.

        Args:
            h_ref_m: New reference chip thickness in m.
        """
        ratio = as_positive("h_ref_m", h_ref_m) / self.h_ref_m
        return replace(
            self,
            kc_ref_pa=self.kc_ref_pa * ratio**-self.mc,
            kr_ref_pa=self.kr_ref_pa * ratio**-self.mr,
            ka_ref_pa=self.ka_ref_pa * ratio**-self.ma,
            h_ref_m=h_ref_m,
        )

    def k11_pa(self) -> tuple[float, float, float]:
        """Return (k_c1.1, k_r1.1, k_a1.1) in Pa, the table values at h = 1 mm, for display and comparison."""
        law = self.at_reference(H_KIENZLE_M)
        return law.kc_ref_pa, law.kr_ref_pa, law.ka_ref_pa

    def scaled(self, factor: float | Directions, status: str | None = None) -> KienzleLaw:
        """Return the law with cutting, radial and axial force multiplied by a factor (> 0), or each by its own."""
        c, r, a = _by_direction(factor)
        return replace(
            self,
            kc_ref_pa=self.kc_ref_pa * c,
            kr_ref_pa=self.kr_ref_pa * r,
            ka_ref_pa=self.ka_ref_pa * a,
            edge_n_m=(self.edge_n_m[0] * c, self.edge_n_m[1] * r, self.edge_n_m[2] * a),
            status=self.status if status is None else status,
        )

    def terms(self) -> Float:
        """Return the law as a sum of powers: rows (p, k_c, k_r, k_a) with ``F'_i = sum k_i h^p``, h in m, F' in N/m.

        Equal exponents share a row, so that a kernel raises to a power as seldom as it can.
        """
        rows: dict[float, list[float]] = {}
        for column, (k_ref, m) in enumerate(
            ((self.kc_ref_pa, self.mc), (self.kr_ref_pa, self.mr), (self.ka_ref_pa, self.ma))
        ):
            rows.setdefault(1.0 - m, [0.0, 0.0, 0.0])[column] += k_ref * self.h_ref_m**m
        if any(self.edge_n_m):
            rows[0.0] = list(self.edge_n_m)
        return np.array([[p, *k] for p, k in rows.items()], dtype=np.float64)

    def edge_force(self, h_m: float | Float) -> Float:
        """Return (F'_c, F'_r, F'_a) in N/m at chip thickness ``h_m`` (m); zero where h <= 0. See :func:`edge_force`."""
        return edge_force(self, h_m)


@dataclass(frozen=True)
class LinearEdgeLaw:
    """Linear law with an edge (ploughing) force: ``F'_i(h) = k_ic h + k_ie`` for h > 0.

    Args:
        ktc_pa: Cutting coefficient in Pa, > 0.
        krc_pa: Radial one, positive away from the edge into the tool.
        kac_pa: Axial one, positive towards the tool tip.
        kte_n_m: Edge force against the motion in N/m.
        kre_n_m: Radial edge force in N/m.
        kae_n_m: Axial edge force in N/m.
        h_min_m: Smallest mean chip thickness of validity in m.
        h_max_m: Largest one in m.
        source: Where the numbers come from.
        status: How they were obtained, as in :class:`KienzleLaw`.

    Raises:
        InputError: A number is outside what the law allows.

    Source: Altintas, Manufacturing Automation; sets from CJME 2021, doi 10.1186/s10033-021-00536-9, table 5.
    """

    ktc_pa: float
    krc_pa: float
    kac_pa: float
    kte_n_m: float
    kre_n_m: float
    kae_n_m: float
    h_min_m: float
    h_max_m: float
    source: str
    status: str

    def __post_init__(self) -> None:
        _check_cutting("ktc_pa", self.ktc_pa)
        for name in ("krc_pa", "kac_pa", "kre_n_m", "kae_n_m"):
            _finite(name, getattr(self, name))
        as_positive("kte_n_m", self.kte_n_m, zero=True)
        _check_range(self.h_min_m, self.h_max_m)

    def scaled(self, factor: float | Directions, status: str | None = None) -> LinearEdgeLaw:
        """Return the law with cutting, radial and axial force multiplied by a factor (> 0), or each by its own."""
        c, r, a = _by_direction(factor)
        return replace(
            self,
            ktc_pa=self.ktc_pa * c,
            krc_pa=self.krc_pa * r,
            kac_pa=self.kac_pa * a,
            kte_n_m=self.kte_n_m * c,
            kre_n_m=self.kre_n_m * r,
            kae_n_m=self.kae_n_m * a,
            status=self.status if status is None else status,
        )

    def terms(self) -> Float:
        """Return the law as a sum of powers, rows (p, k_c, k_r, k_a): p = 1 the chip, p = 0 the edge."""
        return np.array(
            [[1.0, self.ktc_pa, self.krc_pa, self.kac_pa], [0.0, self.kte_n_m, self.kre_n_m, self.kae_n_m]],
            dtype=np.float64,
        )

    def edge_force(self, h_m: float | Float) -> Float:
        """Return (F'_c, F'_r, F'_a) in N/m at chip thickness ``h_m`` (m); zero where h <= 0. See :func:`edge_force`."""
        return edge_force(self, h_m)


class ForceLaw(Protocol):
    """Interface of a force law, as planning and identification use it."""

    @property
    def h_min_m(self) -> float:
        """Smallest mean chip thickness of validity in m."""

    @property
    def h_max_m(self) -> float:
        """Largest mean chip thickness of validity in m."""

    @property
    def source(self) -> str:
        """Source of the numbers."""

    @property
    def status(self) -> str:
        """Way in which they were obtained."""

    def terms(self) -> Float:
        """Rows (p, k_c, k_r, k_a) with ``F'_i = sum k_i h^p``, 0 <= p <= 1, h in m, F' in N/m."""

    def scaled(self, factor: float | Directions, status: str | None = None) -> ForceLaw:
        """The law with cutting, radial and axial force multiplied by a factor (> 0), or each by its own."""

    def edge_force(self, h_m: float | Float) -> Float:
        """(F'_c, F'_r, F'_a) in N/m at chip thickness ``h_m`` (m), see :func:`edge_force`."""


def edge_force(law: ForceLaw, h_m: float | Float) -> Float:
    """Return the force per length of edge at given chip thicknesses.

    Args:
        h_m: Uncut chip thickness in m, any shape; at h <= 0 the edge does not cut and the force is zero.

    Returns:
        Shape ``(*h.shape, 3)``, N/m: cutting, radial, axial.
    """
    h = np.asarray(h_m, dtype=np.float64)
    cut = h > 0.0
    safe = np.where(cut, h, 1.0)
    force = np.zeros((*h.shape, 3))
    for p, kc, kr, ka in law.terms():
        force += np.where(cut, safe**p, 0.0)[..., None] * np.array([kc, kr, ka])
    return force


def check_thickness(
    law: ForceLaw, h_mean_m: float, *, allow_extrapolation: bool = False, where: str | None = None
) -> bool:
    """Check a mean chip thickness against the range the coefficients are good for.

    The criterion is the *mean* thickness over the engaged arc: every arc that starts or ends tangentially passes
    through h = 0, also in the tests the coefficients come from, so that part of the arc is inside the range by the
    way the constants are identified (:func:`counterflex.cutting.force.extrapolated_share` says how much force it
    carries).

    Args:
        h_mean_m: Mean chip thickness over the engaged arc in m.
        allow_extrapolation: Return False outside the range instead of raising.
        where: Place to name in the error (operation, program line).

    Returns:
        True inside [h_min_m, h_max_m], False outside.

    Raises:
        ModelError: Outside the range and ``allow_extrapolation`` is False.
    """
    if law.h_min_m <= h_mean_m <= law.h_max_m:
        return True
    if allow_extrapolation:
        return False
    raise ModelError(
        "mean chip thickness is outside the range of the force coefficients",
        where=where,
        value=f"{h_mean_m / MM:.4g} mm",
        limit=f"{law.h_min_m / MM:.4g} to {law.h_max_m / MM:.4g} mm",
        hint=f"Source: {law.source}. Use coefficients identified there, or allow extrapolation explicitly",
    )
