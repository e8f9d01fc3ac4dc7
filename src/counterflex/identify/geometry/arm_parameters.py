"""Parameters of an arm's geometry: displacements behind its driven segments, its sag, its drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, cast

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM, MRAD
from counterflex.identify.data.model import CellModel
from counterflex.identify.geometry.arm_geometry import ArmGeometry, ArmLayout, PeriodicTerm
from counterflex.identify.geometry.pose_residuals import COMPONENTS
from counterflex.identify.solver.parameters import Parameter, Parameters
from counterflex.robot.elasticity.axis_sag import LARGEST_RAD as LARGEST_SAG_RAD, TERMS, arm_is_heavy, unit_turns
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.model.calibration import BASE, LARGEST_M, LARGEST_RAD, TCP

Sag = Literal["off", "cell", "masses", "torsion", "axes"]
SAGS: Final = ("auto", "off", "cell", "masses", "torsion", "axes")
TORSION: Final = 5e-5
"""Prior standard deviation of an unknown torsion compliance, rad/(N m): 20 kN m/rad."""


@dataclass(frozen=True)
class ArmPriors:
    """Standard deviations of an arm before it is measured."""

    length_m: float = 0.5 * MM  # of each displacement
    angle_rad: float = 0.5 * MRAD  # of each rotation
    mass: float = 0.1  # of each mass, relative
    periodic_rad: float = 0.3 * MRAD  # of each amplitude of a drive's periodic error
    # of each product of a compliance and a weight's first moment, where masses are not known. Arms of all payload
    # classes are built so that their weight turns axes 2 and 3 by some tenths of a mrad to some mrad
    sag_rad: float = 1.0 * MRAD
    zero_rad: float | None = None  # of each zero of an axis (the rotation about it); None is that of the rotations

    def __post_init__(self) -> None:
        """Check that all are above zero."""
        for name in ("length_m", "angle_rad", "mass", "periodic_rad", "sag_rad", "of_zero"):
            if not getattr(self, name) > 0.0:
                raise InputError("a prior standard deviation must be above zero", where=name, value=getattr(self, name))

    @property
    def of_zero(self) -> float:
        """Standard deviation of the zero of an axis, rad."""
        return self.angle_rad if self.zero_rad is None else self.zero_rad


@dataclass(frozen=True, eq=False)
class ArmModel:
    """An arm ready to be placed in poses."""

    chain: ElasticChain  # nominal chain with the cell's compliances and masses
    layout: ArmLayout  # places of its parameters; they are the first of all
    parameters: Parameters
    sag: Sag  # how own weight is treated

    def at(self, q: Float, sense: Float | None = None) -> ArmGeometry:
        """The arm in poses q (m, 6) rad, to which its axes came in the senses (m, 6), +1, -1 or 0; None: not known."""
        arm = ArmGeometry(self.chain, self.layout, np.asarray(q, dtype=np.float64), sense=sense)
        if self.layout.turns is not None:
            arm = replace(arm, unit_turns=unit_turns(self.chain, arm.q))
        return arm if self.sag == "off" else arm.settled()

    def with_periodic(self, orders: int | Sequence[int], axes: Sequence[int], prior: float) -> ArmModel:
        """The same with periodic errors of the given axes: of the orders named, or of 1 to a number."""
        items, terms, place = [], [], len(self.parameters)
        for axis in axes:
            for k in range(1, orders + 1) if isinstance(orders, int) else orders:
                terms.append(PeriodicTerm(axis, k, place, place + 1))
                place += 2
                items += [
                    Parameter(
                        name=f"drive{axis + 1}.{part}{k}",
                        unit="rad",
                        nominal=0.0,
                        prior_sigma=prior,
                        label=f"drive {axis + 1}, {part} of {k} times its angle",
                    )
                    for part in ("sin", "cos")
                ]
        return replace(
            self,
            layout=replace(self.layout, periodic=(*self.layout.periodic, *terms)),
            parameters=self.parameters + Parameters.of(items),
        )


def with_lost_motion(model: ArmModel, axes: Sequence[int], prior_rad: float) -> ArmModel:
    """A model with half of the lost motion of some axes 0..5 as parameters."""
    first = len(model.parameters)
    items = [
        Parameter(
            name=f"axis{axis + 1}.lost",
            unit="rad",
            nominal=0.0,
            prior_sigma=prior_rad,
            label=f"half of the lost motion of axis {axis + 1}, by the sense of approach",
        )
        for axis in axes
    ]
    lost = {axis: first + k for k, axis in enumerate(axes)}
    return replace(model, layout=replace(model.layout, lost=lost), parameters=model.parameters + Parameters.of(items))


def sag_of(chain: ElasticChain, requested: str) -> Sag:
    """Treatment of own weight.

    ``requested``: ``auto`` finds masses where the cell knows how soft the arm is, torsion where it knows only masses,
    and the sag of axes 2 and 3 where it knows no masses of the arm; or one of the others. Raises InputError: another
    word, or one that the chain's masses and compliances do not allow.
    """
    if requested not in SAGS:
        raise InputError("unknown treatment of own weight", where="sag", value=requested, limit=", ".join(SAGS))
    heavy, soft = bool(np.any(chain.mass > 0.0)), bool(np.any(chain.compliance > 0.0))
    if requested == "auto":
        return "axes" if not arm_is_heavy(chain) else ("masses" if soft else "torsion")
    if requested in ("masses", "cell") and not (heavy and soft):
        raise InputError(
            "the cell has no masses or no compliances to compute sag from",
            where=f"sag = {requested}",
            hint="Give mass_kg and compliances in the cell file, or set sag=off",
        )
    if requested == "torsion" and not heavy:
        raise InputError("the cell has no masses", where="sag = torsion", hint="Give mass_kg in the cell file")
    if requested == "axes" and arm_is_heavy(chain):
        raise InputError(
            "the robot has masses: their sag would count twice",
            where="sag = axes",
            hint="Set sag=masses or sag=torsion, or give the robot mass_kg = 0 from axis 2 on",
        )
    return cast(Sag, requested)


def sag_as_known(chain: ElasticChain) -> Sag:
    """Model of own weight for uses where the sag adds no parameters."""
    how = sag_of(chain, "auto")
    if how == "axes":  # what hangs on the flange may have a mass all the same
        return "cell" if np.any(chain.mass > 0.0) and np.any(chain.compliance > 0.0) else "off"
    return "off" if how == "torsion" else how


def arm_model(
    cell: CellModel,
    priors: ArmPriors,
    *,
    sag: str = "auto",
    base: bool = False,
    flange: bool = False,
    tool: bool = False,
) -> ArmModel:
    """The arm of a cell with parameters for what its geometry may be off by.

    ``base``: The whole arm may be displaced in its base; only something known in the base tells. ``flange``: What
    follows axis 6 may be displaced; only a target or tool known in the flange or tool tells. ``tool``: The tool centre
    point may be displaced in its body; only what the tip itself touches tells.
    """
    chain = cell.nominal_chain
    driven = [chain.names[i] for i in np.flatnonzero(chain.joint >= 0)]
    names = [*([BASE] if base else []), *(driven if flange else driven[:-1]), *([TCP] if tool else [])]
    items: list[Parameter] = []
    displaced = {}
    for name in names:
        displaced[name] = np.arange(len(items), len(items) + 6, dtype=np.int64)
        before = cell.calibration.get(name, np.zeros(6))
        for c, component in enumerate(COMPONENTS):
            largest = LARGEST_M if c < 3 else LARGEST_RAD
            items.append(
                Parameter(
                    name=f"{name}.d{component}",
                    unit="m" if c < 3 else "rad",
                    nominal=float(before[c]),
                    prior_sigma=(*(priors.length_m,) * 3, *(priors.angle_rad,) * 2, priors.of_zero)[c],
                    lower=-largest,
                    upper=largest,
                    label=f"displacement after {name}, {component}",
                )
            )
    # What an earlier calibration found and this one cannot see stays in the model: left out, it would return as another
    # error.
    known = {name: np.asarray(d) for name, d in cell.calibration.items() if name not in displaced}
    how, first = sag_of(chain, sag), len(items)
    items += _sag_parameters(chain, priors, how)
    places = {how: np.arange(first, len(items), dtype=np.int64)}
    soft = {
        (int(i), 5): int(k) for i, k in zip(np.flatnonzero(chain.joint >= 0), places.get("torsion", ()), strict=False)
    }
    mass = {int(i): int(k) for i, k in zip(np.flatnonzero(chain.mass > 0.0), places.get("masses", ()), strict=False)}
    return ArmModel(chain, ArmLayout(displaced, known, soft, mass, turns=places.get("axes")), Parameters.of(items), how)


def _sag_parameters(chain: ElasticChain, priors: ArmPriors, how: str) -> list[Parameter]:
    """Parameters of the sag: masses of bodies, torsions of axes, or turns of axes 2 and 3."""
    if how == "masses":
        return [
            Parameter(f"{chain.names[i]}.mass", "kg", float(chain.mass[i]), priors.mass, 0.0, log=True,
                      label=f"mass of {chain.names[i]}")
            for i in np.flatnonzero(chain.mass > 0.0)
        ]  # fmt: skip
    if how == "torsion":
        return [
            Parameter(f"{chain.names[i]}.rz", "rad/(N m)", float(chain.compliance[i, 5]), TORSION, 0.0,
                      label=f"torsion compliance of {chain.names[i]}")
            for i in np.flatnonzero(chain.joint >= 0)
        ]  # fmt: skip
    return [
        Parameter(
            name=f"sag{axis + 1}.link{link + 1}_{direction}",
            unit="rad",
            nominal=0.0,
            prior_sigma=priors.sag_rad,
            lower=-LARGEST_SAG_RAD,
            upper=LARGEST_SAG_RAD,
            label=f"turn of axis {axis + 1} by the weight of link {link + 1} along its {direction}",
        )
        for axis, link, direction in (TERMS if how == "axes" else ())
    ]
