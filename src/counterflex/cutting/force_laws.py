"""Force laws by name: what ``[material] law`` may say, with the keys of the cell file that each law reads.

Every law is a sum of powers of the chip thickness (:mod:`counterflex.cutting.coefficients`); the kernels know nothing
more of it. Another package adds a law with an entry point of the group ``counterflex.force_laws`` (docs/extend.md);
its keys stand in ``[material.parameters]``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from counterflex.core.errors import CounterflexError, InputError
from counterflex.core.registry import Registry
from counterflex.core.units import N_PER_MM, N_PER_MM2
from counterflex.cutting.coefficients import ForceLaw, KienzleLaw, LinearEdgeLaw, edge_force


@dataclass(frozen=True)
class ValidFor:
    """Range of validity of a law, and the source of its numbers."""

    h_min_m: float  # smallest mean chip thickness in m
    h_max_m: float  # largest one in m
    source: str  # of the numbers, for messages and reports
    status: str  # how they were obtained


@dataclass(frozen=True)
class LawKind:
    """A force law that a cell file can name."""

    title: str  # one line for help and reports
    # makes the law of the values of the cell file, by key and in the units that the keys name, and of what it is good
    # for
    build: Callable[[Mapping[str, float], ValidFor], ForceLaw]
    # lowest and highest value of each key of `[material.parameters]`; every key is required. Empty for our own laws,
    # whose keys stand in `[material]` itself
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)


def require_parameters(name: str, kind: LawKind, values: Mapping[str, float]) -> None:
    """Check ``[material.parameters]`` against what a law asks for.

    Raises:
        ValueError: A key is unknown, missing, or outside its range; one line says which.
    """
    unknown = sorted(set(values) - set(kind.ranges))
    if unknown:
        raise ValueError(f"the {name} law has no parameter {unknown[0]}; it has {', '.join(kind.ranges) or 'none'}")
    for key, (low, high) in kind.ranges.items():
        if key not in values:
            raise ValueError(f"the {name} law needs {key} in [material.parameters]")
        if not low <= values[key] <= high:
            raise ValueError(f"{key} = {values[key]:g} is outside {low:g} to {high:g}, the range of the {name} law")


def built(name: str, values: Mapping[str, float], valid: ValidFor) -> ForceLaw:
    """The law of a name.

    Args:
        name: One of :data:`FORCE_LAWS`.
        values: Of the cell file, by key and in the units that the keys name.
        valid: What the law is good for.

    Raises:
        InputError: There is no such law, a value is refused, or the law of another package is not usable: building
            it fails, or it is no finite sum of powers with exponents between 0 and 1 and a force against the motion.
    """
    kind = FORCE_LAWS[name]
    if name in FORCE_LAWS.own:
        return kind.build(values, valid)
    try:
        law = kind.build(values, valid)
        _require_sum_of_powers(law)
    except CounterflexError:
        raise
    # Whatever another package raises becomes one line that names it.
    except Exception as fault:
        raise InputError(
            f"the force law of another package fails: {type(fault).__name__}: {fault}", where=name, value=dict(values)
        ) from fault
    return law


def _require_sum_of_powers(law: ForceLaw) -> None:
    terms = np.asarray(law.terms(), dtype=np.float64)
    limit = "rows (p, k_c, k_r, k_a) of finite numbers, 0 <= p <= 1"
    if terms.ndim != 2 or terms.shape[1:] != (4,) or not len(terms):
        raise InputError("the force law gives no sum of powers", value=f"shape {terms.shape}", limit=limit)
    if not np.all(np.isfinite(terms)) or np.any((terms[:, 0] < 0.0) | (terms[:, 0] > 1.0)):
        raise InputError("the force law gives no sum of powers", value=terms.tolist(), limit=limit)
    if not np.all(edge_force(law, np.linspace(law.h_min_m, law.h_max_m, 9))[:, 0] > 0.0):
        raise InputError("the force law pushes the edge along its own motion", limit="a cutting force > 0")


def _kienzle(values: Mapping[str, float], valid: ValidFor) -> KienzleLaw:
    kc11, mc = values["kc11_n_mm2"], values["mc"]
    law = KienzleLaw.from_k11(
        kc11 * N_PER_MM2,
        mc,
        kr11_pa=values["kr_over_kc"] * kc11 * N_PER_MM2,
        mr=values.get("mr", mc),
        ka11_pa=values["ka_over_kc"] * kc11 * N_PER_MM2,
        ma=values.get("ma", mc),
        h_min_m=valid.h_min_m,
        h_max_m=valid.h_max_m,
        source=valid.source,
        status=valid.status,
    )
    edge_c, edge_r, edge_a = (values.get(f"edge_{direction}_n_mm", 0.0) * N_PER_MM for direction in "cra")
    return replace(law, edge_n_m=(edge_c, edge_r, edge_a))


def _linear_edge(values: Mapping[str, float], valid: ValidFor) -> LinearEdgeLaw:
    return LinearEdgeLaw(
        ktc_pa=values["ktc_n_mm2"] * N_PER_MM2,
        krc_pa=values["krc_n_mm2"] * N_PER_MM2,
        kac_pa=values.get("kac_n_mm2", 0.0) * N_PER_MM2,
        kte_n_m=values.get("kte_n_mm", 0.0) * N_PER_MM,
        kre_n_m=values.get("kre_n_mm", 0.0) * N_PER_MM,
        kae_n_m=values.get("kae_n_mm", 0.0) * N_PER_MM,
        h_min_m=valid.h_min_m,
        h_max_m=valid.h_max_m,
        source=valid.source,
        status=valid.status,
    )


KIENZLE: Final = LawKind("Kienzle: k_1.1 and an exponent for each direction, with edge forces", _kienzle)
LINEAR_EDGE: Final = LawKind("linear in the chip thickness, with edge forces", _linear_edge)

FORCE_LAWS: Final[Registry[LawKind]] = Registry(
    "counterflex.force_laws",
    "force law",
    "counterflex.cutting.force_laws:LawKind",
    {"kienzle": "counterflex.cutting.force_laws:KIENZLE", "linear_edge": "counterflex.cutting.force_laws:LINEAR_EDGE"},
)
