"""Forms of the force law that test cuts can be fitted with, and what is known of their constants beforehand.

All forms share nine numbers at a reference thickness h_ref: the specific forces k of the directions c (cutting), r
(radial) and a (axial), their exponents m, and the edge forces e:

    F'_i(h) = k_i h (h / h_ref)^-m_i + e_i,   i = c, r, a

A form says which of them are free: one exponent for all directions or three, with or without edge forces. All
exponents zero is the linear law with an edge force. Fitting k at a thickness inside the data instead of at 1 mm takes
away nearly all of its correlation with m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError, ModelError
from counterflex.core.units import N_PER_MM
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw, LinearEdgeLaw
from counterflex.identify.solver.fit import Fit
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.identify.solver.residuals import Residuals
from counterflex.identify.solver.solve import solve

DIRECTIONS: Final = ("c", "r", "a")
NAMES: Final = ("kc", "kr", "ka", "mc", "mr", "ma", "ec", "er", "ea")
"""Names of the nine constants in the order of the parameters."""
EDGES: Final = NAMES[6:]
"""Names of the edge forces."""
_WORDS: Final = ("cutting", "radial", "axial")
_K_SIGMA: Final = (0.5, 0.3, 0.2)  # of k_c, known beforehand
_M_SIGMA: Final = (0.15, 0.25, 0.25)
_E_SIGMA: Final = (10.0 * N_PER_MM, 10.0 * N_PER_MM, 3.0 * N_PER_MM)
_M_MOST: Final = 0.9


@dataclass(frozen=True)
class ForceForm:
    """A form of the law."""

    name: str  # as typed in settings
    text: str
    exponents: int  # number of free exponents: 0 (the linear law), 1 for all directions together, or 3
    edge: bool  # whether edge forces are free

    @property
    def count(self) -> int:
        """Number of free constants."""
        return 3 + self.exponents + (3 if self.edge else 0)

    @property
    def exponent_of(self) -> tuple[int, int, int]:
        """Place of the parameter that is the exponent of c, r, a."""
        return (3, 3, 3) if self.exponents == 1 else (3, 4, 5)

    def parameters(self, law: ForceLaw, h_ref_m: float) -> Parameters:
        """The nine constants around those of a known law."""
        k, m, e = constants(law, h_ref_m)
        if self.exponents == 0:
            m = (0.0, 0.0, 0.0)
        items = [
            Parameter(
                NAMES[i], "Pa", k[i], _K_SIGMA[i] * k[0], lower=0.02 * k[0] if i == 0 else -np.inf,
                label=f"{_WORDS[i]} constant k{DIRECTIONS[i]}",
            )
            for i in range(3)
        ]  # fmt: skip
        items += [
            Parameter(
                NAMES[3 + i], "1", m[i], _M_SIGMA[i], lower=0.0, upper=max(_M_MOST, m[i]),
                free=self.exponents == 3 or (self.exponents == 1 and i == 0),
                label="exponent m" if self.exponents == 1 and i == 0 else f"{_WORDS[i]} exponent m{DIRECTIONS[i]}",
            )
            for i in range(3)
        ]  # fmt: skip
        items += [
            Parameter(
                NAMES[6 + i], "N/m", e[i], _E_SIGMA[i], free=self.edge,
                label=f"{_WORDS[i]} edge force e{DIRECTIONS[i]}",
            )
            for i in range(3)
        ]  # fmt: skip
        return Parameters.of(items)

    def law(self, x: Float, h_ref_m: float, h_min_m: float, h_max_m: float, source: str) -> ForceLaw:
        """The law of fitted constants.

        ``x``: (>= 9,) values in the order of :data:`NAMES`.
        """
        k, e = x[:3].tolist(), x[6:9].tolist()
        m = [float(x[i]) for i in self.exponent_of]
        if self.exponents == 0:
            return LinearEdgeLaw(k[0], k[1], k[2], e[0], e[1], e[2], h_min_m, h_max_m, source, "measured")
        return KienzleLaw(
            k[0], m[0], k[1], m[1], k[2], m[2], h_ref_m, h_min_m, h_max_m, source, "measured", (e[0], e[1], e[2])
        )


FORMS: Final = (
    ForceForm("kienzle", "Kienzle, one exponent", 1, False),
    ForceForm("kienzle-3", "Kienzle, an exponent for each direction", 3, False),
    ForceForm("linear", "linear law with an edge force", 0, True),
    ForceForm("kienzle-edge", "Kienzle with an edge force, one exponent", 1, True),
    ForceForm("kienzle-3-edge", "Kienzle with an edge force, an exponent for each direction", 3, True),
)
"""From few constants to many."""


def form(name: str) -> ForceForm:
    """The form of a name. Raises InputError: there is none."""
    for item in FORMS:
        if item.name == name:
            return item
    raise InputError("there is no such form of the force law", value=name, limit=", ".join(f.name for f in FORMS))


def constants(
    law: ForceLaw, h_ref_m: float
) -> tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]:
    """(k, m, e) of c, r, a at a reference thickness."""
    if isinstance(law, LinearEdgeLaw):
        return ((law.ktc_pa, law.krc_pa, law.kac_pa), (0.0, 0.0, 0.0), (law.kte_n_m, law.kre_n_m, law.kae_n_m))
    if not isinstance(law, KienzleLaw):
        raise ModelError(
            "test cuts are fitted with Kienzle's law or the linear one, and start at the law of the cell file",
            value=type(law).__name__,
            limit='law = "kienzle" or "linear_edge" in [material]',
        )
    at = law.at_reference(h_ref_m)
    return (at.kc_ref_pa, at.kr_ref_pa, at.ka_ref_pa), (at.mc, at.mr, at.ma), at.edge_n_m


def solve_physical(parameters: Parameters, block: Residuals) -> Fit:
    """Fit the constants; an edge force that comes out below zero, which no edge has, is held at zero."""
    fit = solve(parameters, [block])
    for _ in EDGES:
        negative = [name for name in EDGES if fit.value(name) < 0.0]
        if not negative:
            break
        # One by one, the most negative first: with it held, the others often come out positive.
        least = min(negative, key=fit.value)
        parameters = parameters.with_nominal({least: 0.0}).with_fixed([least])
        fit = solve(parameters, [block])
    return fit
