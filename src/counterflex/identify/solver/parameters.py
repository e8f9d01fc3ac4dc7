"""Named parameters of an identification, with what is known about them before anything is measured.

A parameter is linear (fit coordinate ``u = (x - nominal) / prior_sigma``) or, for what can only be positive,
logarithmic (``u = ln(x / nominal) / prior_sigma``, relative prior sigma). In fit coordinates every prior is N(0, 1).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError


@dataclass(frozen=True)
class Parameter:
    """One number to find."""

    name: str  # unique and telling, for example `axis1.rz` or `T_base_tracker.x`
    unit: str  # SI unit, for messages and reports: `m`, `rad`, `rad/(N m)`, `Pa`, `1`
    nominal: float  # value before the measurement, SI
    # standard deviation of that knowledge: SI, or relative for a logarithmic parameter; infinity is no knowledge at all
    # (then `scale` says what a change of ordinary size is)
    prior_sigma: float
    lower: float = -np.inf  # least value that makes sense
    upper: float = np.inf
    free: bool = True  # False holds it at `nominal`
    log: bool = False  # logarithmic; `nominal` must be positive
    scale: float = 1.0  # size of an ordinary change where the prior is infinite; else unused
    label: str = ""  # what a user calls it, for tables; the name where empty

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InputError: Nominal outside the bounds, sigma or scale not positive, logarithmic without positive nominal.
        """
        if not np.isfinite(self.nominal) or not self.lower <= self.nominal <= self.upper:
            raise InputError(
                "the nominal value of a parameter is out of its bounds",
                where=self.name,
                value=self.nominal,
                limit=f"{self.lower:g} .. {self.upper:g} {self.unit}",
            )
        if not self.prior_sigma > 0.0 or not (np.isfinite(self.scale) and self.scale > 0.0):
            raise InputError("prior sigma and scale must be above zero", where=self.name, value=self.prior_sigma)
        if self.log and self.nominal <= 0.0:
            raise InputError("a logarithmic parameter needs a positive nominal", where=self.name, value=self.nominal)

    @property
    def has_prior(self) -> bool:
        """Return whether something is known beforehand."""
        return bool(np.isfinite(self.prior_sigma))

    @property
    def unit_step(self) -> float:
        """Change that one unit of the fit coordinate means: SI, or relative for a logarithmic parameter."""
        return self.prior_sigma if self.has_prior else self.scale


@dataclass(frozen=True, eq=False)
class Parameters:
    """An ordered set of parameters."""

    items: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        """Check that names differ."""
        names = [item.name for item in self.items]
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise InputError("two parameters have the same name", value=twice)

    @classmethod
    def of(cls, items: Iterable[Parameter]) -> Parameters:
        """Collect parameters."""
        return cls(tuple(items))

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.items)

    def __add__(self, other: Parameters) -> Parameters:
        return Parameters((*self.items, *other.items))

    @property
    def names(self) -> tuple[str, ...]:
        """Their names, in order."""
        return tuple(item.name for item in self.items)

    @property
    def free(self) -> Bool:
        """(p,) which of them are free."""
        return np.array([item.free for item in self.items], dtype=np.bool_)

    @property
    def nominal(self) -> Float:
        """(p,) nominal values, SI."""
        return self._nominal.copy()

    @cached_property
    def _nominal(self) -> Float:
        return np.array([item.nominal for item in self.items], dtype=np.float64)

    @cached_property
    def _steps(self) -> Float:
        """(p,) change that one unit of each fit coordinate means."""
        return np.array([item.unit_step for item in self.items], dtype=np.float64)

    @cached_property
    def _logarithmic(self) -> tuple[int, ...]:
        """Places of the logarithmic ones."""
        return tuple(i for i, item in enumerate(self.items) if item.log)

    @property
    def units(self) -> dict[str, str]:
        """SI unit of each free parameter, by name."""
        return {item.name: item.unit for item in self.items if item.free}

    def index(self, name: str) -> int:
        """Place of a parameter. Raises InputError: there is none of that name."""
        try:
            return self.names.index(name)
        except ValueError as fault:
            raise InputError("there is no such parameter", value=name, limit=", ".join(self.names)) from fault

    def with_nominal(self, values: Mapping[str, float]) -> Parameters:
        """The same set around other nominal values."""
        return Parameters(tuple(replace(p, nominal=values.get(p.name, p.nominal)) for p in self.items))

    def with_fixed(self, names: Iterable[str]) -> Parameters:
        """The same set with these parameters held at their nominal values."""
        fixed = set(names)
        for name in fixed:
            self.index(name)
        return Parameters(tuple(replace(p, free=p.free and p.name not in fixed) for p in self.items))

    def values(self, u: Float) -> Float:
        """SI values (p,) of fit coordinates (p,)."""
        out: Float = self._nominal + self._steps * u
        for i in self._logarithmic:
            out[i] = self._nominal[i] * np.exp(self._steps[i] * u[i])
        return out

    def coordinates(self, x: Float) -> Float:
        """Fit coordinates (p,) of SI values (p,)."""
        out: Float = (x - self._nominal) / self._steps
        for i in self._logarithmic:
            out[i] = np.log(x[i] / self._nominal[i]) / self._steps[i]
        return out

    def slope(self, x: Float) -> Float:
        """(p,) derivative of the SI value by the fit coordinate at the values x (p,)."""
        out = self._steps.copy()
        for i in self._logarithmic:
            out[i] *= x[i]
        return out

    def bounds(self) -> tuple[Float, Float]:
        """Lower and upper bounds (p,) of the fit coordinates."""
        lower = np.array([-np.inf if p.log and p.lower <= 0.0 else _bound(p, p.lower) for p in self.items])
        upper = np.array([_bound(p, p.upper) for p in self.items])
        return lower, upper


def _bound(p: Parameter, value: float) -> float:
    if not np.isfinite(value):
        return value
    return float((np.log(value / p.nominal) if p.log else value - p.nominal) / p.unit_step)
