"""Work materials as data: force coefficients with source, status, range of validity and conditions, row by row.

The rows live in ``material_data/kienzle.csv`` (b = h = 1 mm) and ``material_data/linear_edge.csv``. Where a source
gives no radial or axial coefficient the row has none: :meth:`Material.with_ratios` makes the user say what is assumed.
Spread between sources is +-30 % for the same material (titanium x1.7), so a row is a starting value and the
coefficients of tool and material together are to be identified. Two entries of the survey behind the tables make no
law and are left out: hardened X37CrMoV5-1 (no exponent known) and CFRP (the force follows the fibre angle).
"""

from __future__ import annotations

import csv
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Final

from counterflex.core.arrays import as_positive
from counterflex.core.errors import FileFormatError, InputError, ModelError
from counterflex.core.registry import Registry
from counterflex.core.similar import did_you_mean
from counterflex.core.units import DEG, MM, N_PER_MM, N_PER_MM2
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw, LinearEdgeLaw

_STATUS = {"measured", "catalogue", "derived", "assumed"}
_TEXTS = ("name", "material", "number", "h_range_basis", "status", "conditions", "source")


@dataclass(frozen=True)
class VictorFactors:
    """Correction factors of the specific force, ``k = k_1.1 h^-m K_gamma K_v K_st K_ver K_sch K_kss``.

    Every factor is 1 unless stated. Values in print: ``K_st`` 1.2 for milling, drilling and boring against 1.0 for
    outside turning; ``K_ver`` 1.3 for a worn tool (30 %), up to 1.5; ``K_v`` 1.0 for carbide above 100 m/min, 1.2 for
    HSS. Tables of milling tests contain them already.

    Raises:
        InputError: A factor is not positive.

    Source: Dietrich/Tschaetsch, Praxis der Zerspantechnik, 11th ed. (values); German Wikipedia, Kienzle-Formel
    (names of all six).
    """

    k_gamma: float = 1.0  # rake angle, from rake_factor
    k_v: float = 1.0  # cutting speed
    k_st: float = 1.0  # chip compression by the kind of process
    k_ver: float = 1.0  # wear
    k_sch: float = 1.0  # cutting material
    k_kss: float = 1.0  # coolant

    def __post_init__(self) -> None:
        for name in ("k_gamma", "k_v", "k_st", "k_ver", "k_sch", "k_kss"):
            as_positive(name, getattr(self, name))

    @property
    def product(self) -> float:
        """Product of the six factors."""
        return self.k_gamma * self.k_v * self.k_st * self.k_ver * self.k_sch * self.k_kss


def rake_factor(rake_rad: float, base_rake_rad: float) -> float:
    """Return Victor's rake correction ``K_gamma = 1 - (gamma - gamma_0) / 100``, angles in deg in the formula.

    Args:
        rake_rad: Rake angle gamma of the tool in rad.
        base_rake_rad: Rake gamma_0 the table value was measured with, in rad: 6 deg steel, 2 deg cast iron; for
            aluminium 12 deg (Tabellenbuch Zerspantechnik) or 0 deg (Dietrich/Tschaetsch), a 12 % trap.

    Raises:
        InputError: A rake beyond +-45 deg (an angle in degrees?).

    Source: Dietrich/Tschaetsch 11th ed.; Tabellenbuch Zerspantechnik 5th ed. 2022.
    """
    for name, angle in (("rake_rad", rake_rad), ("base_rake_rad", base_rake_rad)):
        if not abs(angle) <= 45.0 * DEG:
            raise InputError(f"{name} is out of range", value=angle, limit="-pi/4 to pi/4", hint="Is it in degrees?")
    return 1.0 - (rake_rad - base_rake_rad) / DEG / 100.0


@dataclass(frozen=True)
class Material:
    """One row of a coefficient table."""

    name: str  # key of the row
    designation: str  # what the source calls the material
    number: str  # material number, empty where unknown
    kind: str  # `kienzle` or `linear`
    cutting: tuple[float, float]  # Kienzle (k_c1.1 in Pa, m_c); linear (k_tc in Pa, k_te in N/m)
    radial: tuple[float, float] | None  # the same for the radial direction, None where the source gives none
    # the same for the axial direction (positive towards the tool tip), None where the source gives none
    axial: tuple[float, float] | None
    h_min_m: float  # smallest mean chip thickness of validity in m
    h_max_m: float  # largest one in m
    h_range_basis: str  # where that range comes from
    base_rake_rad: float | None  # rake angle the values refer to in rad, None where unknown
    status: str  # `measured`, `catalogue`, `derived` or `assumed`, or several joined by ` + `
    conditions: str  # tool, process and fit behind the numbers
    source: str  # where they are printed

    def law(self, factors: VictorFactors | None = None) -> ForceLaw:
        """Return the force law of a row that is complete.

        Args:
            factors: Victor's corrections, applied to all coefficients.

        Raises:
            ModelError: The row has no radial or no axial coefficient.
        """
        missing = [name for name in ("radial", "axial") if getattr(self, name) is None]
        if missing:
            raise ModelError(
                f"material has no {' and no '.join(missing)} force coefficient",
                where=self.name,
                hint="Give the ratios kr_over_kc and ka_over_kc as your own assumption, or identify the coefficients",
            )
        return self.with_ratios(factors=factors)

    def with_ratios(
        self, *, kr_over_kc: float | None = None, ka_over_kc: float | None = None, factors: VictorFactors | None = None
    ) -> ForceLaw:
        """Return the force law with assumed ratios for the directions that the row does not know.

        An assumed direction takes the exponent (or the edge-to-chip proportion) of the cutting direction.

        Args:
            kr_over_kc: Radial over cutting coefficient, only where the row has no radial one.
            ka_over_kc: Axial over cutting coefficient, only where the row has no axial one; positive pulls the tool
                out of its holder.
            factors: Victor's corrections, applied to all coefficients.

        Returns:
            The law; its status names the assumption.

        Raises:
            InputError: A ratio for a direction that the row knows.
            ModelError: No ratio for a direction that it does not know.
        """
        pairs: dict[str, tuple[float, float]] = {}
        assumed = False
        for direction, ratio, own in (("radial", kr_over_kc, self.radial), ("axial", ka_over_kc, self.axial)):
            name = "kr_over_kc" if direction == "radial" else "ka_over_kc"
            if own is not None and ratio is not None:
                raise InputError(f"material has a {direction} coefficient of its own", where=self.name, value=name)
            if own is None and ratio is None:
                raise ModelError(
                    f"material has no {direction} force coefficient",
                    where=self.name,
                    hint=f"Give {name} as your own assumption, or identify the coefficient",
                )
            if own is not None:
                pairs[direction] = own
            elif ratio is not None:
                if not math.isfinite(ratio):
                    raise InputError(f"{name} is not finite", value=ratio)
                # The second number of a Kienzle pair is an exponent, of a linear pair a force: only the force is in
                # proportion.
                second = self.cutting[1] * (1.0 if self.kind == "kienzle" else ratio)
                pairs[direction] = (self.cutting[0] * ratio, second)
                assumed = True
        status = f"{self.status} + assumed" if assumed else self.status
        scale = 1.0 if factors is None else factors.product
        kc, kr, ka = self.cutting, pairs["radial"], pairs["axial"]
        if self.kind == "kienzle":
            return KienzleLaw.from_k11(
                kc[0],
                kc[1],
                kr11_pa=kr[0],
                mr=kr[1],
                ka11_pa=ka[0],
                ma=ka[1],
                h_min_m=self.h_min_m,
                h_max_m=self.h_max_m,
                source=self.source,
                status=status,
            ).scaled(scale)
        return LinearEdgeLaw(
            ktc_pa=kc[0],
            krc_pa=kr[0],
            kac_pa=ka[0],
            kte_n_m=kc[1],
            kre_n_m=kr[1],
            kae_n_m=ka[1],
            h_min_m=self.h_min_m,
            h_max_m=self.h_max_m,
            source=self.source,
            status=status,
        ).scaled(scale)


def names() -> tuple[str, ...]:
    """Return the names of all material rows, in the order of the tables, those of other packages last."""
    return (*_own(), *_others())


def load(name: str) -> Material:
    """Return a material row by name.

    Args:
        name: One of :func:`names`.

    Raises:
        InputError: There is no such row.
        FileFormatError: A table of another package cannot be read; those are read only where ours have no such row.
    """
    result = _own().get(name) or _others().get(name)
    if result is None:
        raise InputError(
            "there is no such material",
            value=name,
            hint=did_you_mean(name, names(), 3) or f"There are: {', '.join(names())}",
        )
    return result


OTHER_MATERIALS: Final[Registry[Path]] = Registry("counterflex.materials", "table of materials", "pathlib:Path", {})
"""Tables of other packages: the path of a CSV file with the columns of ``kienzle.csv`` or ``linear_edge.csv``."""


@cache
def _own() -> dict[str, Material]:
    folder = resources.files("counterflex.cutting").joinpath("material_data")
    return _rows([folder / "kienzle.csv", folder / "linear_edge.csv"], {})


@cache
def _others() -> dict[str, Material]:
    return _rows([OTHER_MATERIALS[name] for name in OTHER_MATERIALS], _own())


def _rows(files: Sequence[Traversable], taken: Mapping[str, Material]) -> dict[str, Material]:
    table: dict[str, Material] = {}
    for file in files:
        try:
            rows = csv.DictReader(file.read_text(encoding="utf-8").splitlines())
        except (OSError, UnicodeDecodeError) as fault:
            raise FileFormatError(f"table of materials cannot be read: {fault}", where=file.name) from fault
        kind = "kienzle" if "kc11_n_mm2" in (rows.fieldnames or ()) else "linear"
        for line, row in enumerate(rows, start=2):
            material = _material(row, kind, f"{file.name}:{line}")
            if material.name in table or material.name in taken:
                raise FileFormatError("material name appears twice", where=f"{file.name}:{line}", value=material.name)
            table[material.name] = material
    return table


def _material(row: dict[str, str], kind: str, where: str) -> Material:
    if kind == "kienzle":
        columns = [("kc11_n_mm2", "mc"), ("kr11_n_mm2", "mr"), ("ka11_n_mm2", "ma")]
        second = 1.0
    else:
        columns = [("ktc_n_mm2", "kte_n_mm"), ("krc_n_mm2", "kre_n_mm"), ("kac_n_mm2", "kae_n_mm")]
        second = N_PER_MM
    try:
        pairs = [(float(row[k]) * N_PER_MM2, float(row[m]) * second) if row[k] and row[m] else None for k, m in columns]
        h_min, h_max = float(row["h_min_mm"]) * MM, float(row["h_max_mm"]) * MM
        rake = float(row["gamma0_deg"]) * DEG if row.get("gamma0_deg") else None
    except (KeyError, ValueError, TypeError) as fault:
        raise FileFormatError("material row cannot be read", where=where, value=str(fault)) from fault
    lacking = [name for name in _TEXTS if row.get(name) is None]
    if lacking:
        raise FileFormatError("material row lacks a column", where=where, value=", ".join(lacking))
    if pairs[0] is None or not row["source"] or not set(row["status"].split(" + ")) <= _STATUS:
        raise FileFormatError("material row lacks its cutting coefficient, source or status", where=where)
    if not all(map(math.isfinite, (h_min, h_max, *itertools.chain.from_iterable(filter(None, pairs))))):
        raise FileFormatError("material row holds a number that is not finite", where=where)
    return Material(
        name=row["name"],
        designation=row["material"],
        number=row["number"],
        kind=kind,
        cutting=pairs[0],
        radial=pairs[1],
        axial=pairs[2],
        h_min_m=h_min,
        h_max_m=h_max,
        h_range_basis=row["h_range_basis"],
        base_rake_rad=rake,
        status=row["status"],
        conditions=row["conditions"],
        source=row["source"],
    )
