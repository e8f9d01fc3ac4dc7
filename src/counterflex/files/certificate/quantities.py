"""Quantities of a calibration certificate: values, units, standard uncertainties (coverage factor divided out).

Forms of D-SI: versions 1.3 to 2.1 state ``expandedUnc`` and ``coverageInterval``, versions from 2.2 on
``measurementUncertaintyUnivariate`` with ``expandedMU``, ``coverageIntervalMU`` and ``standardMU``; each also as list.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from counterflex.core.errors import FileFormatError
from counterflex.files.certificate.dsi_unit import parse_unit

SI: Final = "https://ptb.de/si"
DCC: Final = "https://ptb.de/dcc"
_LEAST_K: Final = 1.0
_LISTS: Final = "XMLList"
_READ: Final = ("real", "constant", "realListXMLList", "realList")  # Forms of a quantity that are read
_DEEPEST: Final = 32
_COMMON: Final = ("listUnivariateUnc", "listMeasurementUncertaintyUnivariate")
_NO_NUMBERS: Final = ("noQuantity", "charsXMLList")


@dataclass(frozen=True)
class Quantity:
    """A quantity of a certificate."""

    number: int  # Its place in the certificate, from 1
    name: str
    ident: str = ""  # Its XML id, empty where it has none
    ref_types: tuple[str, ...] = ()  # What kind of quantity it says to be
    values: tuple[float, ...] = ()
    units: tuple[str, ...] = ()  # D-SI, one for each value
    sigma: tuple[float, ...] | None = None  # Standard uncertainties in the same units; None where none is stated
    # Coverage factors that they were divided by; empty where no expanded uncertainty is stated
    coverage: tuple[float, ...] = ()
    unread: str = ""  # What of it is not understood; empty where all is

    def real(self, element: Any, common_unit: str, common: Any, place: str) -> Quantity:
        """One value of a list, with its own uncertainty or the common one."""
        unit = text_of(child(element, "unit")) or common_unit
        row = replace(self, values=_floats(element, "value", place), units=(unit,))
        if len(row.values) != 1 or not unit:
            raise FileFormatError("a value of a list without number or unit", where=place)
        own = row.with_uncertainty(element, place)
        return own if own.sigma is not None or common is None else row.with_uncertainty(common, place)

    def with_uncertainty(self, element: Any, place: str) -> Quantity:
        """The quantity with the standard uncertainty that its element states in one of the forms."""
        count = len(self.values)
        holder = next((one for one in element if local(one).startswith("measurementUncertaintyUnivariate")), element)
        for form in holder:
            name = local(form).removesuffix(_LISTS)
            if name in ("expandedUnc", "expandedMU"):
                key = "uncertainty" if name == "expandedUnc" else "valueExpandedMU"
                stated = _checked(_floats(form, key, place), count, place)
                factors = _spread(_floats(form, "coverageFactor", place), count, "coverage factors", place)
                if min(factors) < _LEAST_K:
                    raise FileFormatError("the coverage factor", where=place, value=min(factors), limit="1 or more")
                sigma = tuple(value / k for value, k in zip(stated, factors, strict=True))
                return replace(self, sigma=sigma, coverage=tuple(factors))
            if name in ("coverageInterval", "coverageIntervalMU"):
                return replace(self, sigma=_checked(_floats(form, _standard(form), place), count, place))
            if name == "standardMU":
                return replace(self, sigma=_checked(_floats(form, "valueStandardMU", place), count, place))
        only_relative = "uncertainty as a share only" if holder is not element and len(holder) else ""
        return replace(self, unread=only_relative or _region(element))


def local(element: Any) -> str:
    """Name of an element without its namespace; empty for comments."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def child(element: Any, name: str) -> Any:
    """First child with a name, or None."""
    return None if element is None else next((one for one in element if local(one) == name), None)


def text_of(element: Any) -> str:
    """Text of an element on one line, empty where there is no element."""
    return "" if element is None else " ".join("".join(element.itertext()).split())


def content(element: Any) -> str:
    """Return what a ``name`` or ``description`` says: English where there is more than one language."""
    if element is None:
        return ""
    contents = [one for one in element if local(one) == "content"]
    english = [one for one in contents if one.get("lang") == "en"]
    return text_of((english or contents or [element])[0])


def read_quantities(results: Any, where: str) -> tuple[Quantity, ...]:
    """All quantities of the results, in their order.

    Args:
        results: Element ``measurementResults``.

    Raises:
        FileFormatError: A quantity contradicts itself: number of values, of units, of uncertainties, coverage below 1.
    """
    quantities: list[Quantity] = []
    for measurement in results:
        for result in child(measurement, "results") if child(measurement, "results") is not None else ():
            data = child(result, "data")
            for path, element in _elements(data, [content(child(result, "name"))], where):
                quantities.append(_quantity(element, len(quantities) + 1, path, where))
    return tuple(quantities)


def _elements(parent: Any, path: list[str], where: str) -> Iterator[tuple[list[str], Any]]:
    if len(path) > _DEEPEST:
        raise FileFormatError("lists within lists", where=where, value=len(path), limit=f"{_DEEPEST} at most")
    for element in parent if parent is not None else ():
        below = [*path, content(child(element, "name"))]
        if local(element) == "quantity":
            yield below, element
        elif local(element) == "list":
            yield from _elements(element, below, where)


def _quantity(element: Any, number: int, path: Sequence[str], where: str) -> Quantity:
    name = " / ".join(dict.fromkeys(part for part in path if part))
    made = Quantity(number, name, element.get("id", ""), tuple((element.get("refType") or "").split()))
    place = f"{where}: quantity {number}{f' ({name})' if name else ''}"
    known = next((one for one in element if local(one) in (*_READ, "hybrid")), None)
    if known is not None and local(known) == "hybrid":
        known = _in_si(known, place)
    if known is None:
        return replace(made, unread=_reason_unread(element))
    return (_real_list if local(known) == "realList" else _numbers)(made, known, place)


def _reason_unread(element: Any) -> str:
    form = next((local(one) for one in element if str(one.tag).startswith(f"{{{SI}}}")), "")
    words = any(local(one) in _NO_NUMBERS for one in element)
    return f"{form or 'this form'} is not read" if form or not words else "text, no number"


def _in_si(hybrid: Any, place: str) -> Any:
    """Of the forms of one quantity the first whose units are all of D-SI."""
    for one in hybrid:
        if local(one) not in _READ:
            continue
        try:
            for unit in _words(one, "unit"):
                parse_unit(unit, place)
        except FileFormatError:
            continue
        return one
    return None


def _words(element: Any, name: str) -> list[str]:
    """Words of a child, which is called otherwise in lists of numbers."""
    single = child(element, name)
    return text_of(single if single is not None else child(element, name + _LISTS)).split()


def _floats(element: Any, name: str, place: str) -> tuple[float, ...]:
    try:
        values = tuple(float(word) for word in _words(element, name))
    except ValueError as fault:
        raise FileFormatError(f"{name} is no number", where=place, value=str(fault)[-40:]) from fault
    if not all(math.isfinite(value) for value in values):
        raise FileFormatError(f"{name} is not finite", where=place)
    return values


def _numbers(made: Quantity, element: Any, place: str) -> Quantity:
    """A single real quantity or a list of them."""
    values = _floats(element, "value", place)
    if not values:
        raise FileFormatError("a quantity without a value", where=place)
    units = _spread(_words(element, "unit"), len(values), "units", place)
    made = replace(made, values=values, units=tuple(units))
    if local(element) == "constant":
        stated = _floats(element, "uncertainty", place)  # of a constant it is the standard deviation
        return replace(made, sigma=_checked(stated, len(values), place) if stated else None)
    return made.with_uncertainty(element, place)


def _real_list(made: Quantity, element: Any, place: str) -> Quantity:
    """Form ``si:realList``: each value an element of its own, unit and uncertainty there or common to all."""
    common_unit = text_of(child(element, "listUnit"))
    common = next((one for one in element if local(one) in _COMMON), None)
    rows = [made.real(one, common_unit, common, place) for one in element if local(one) == "real"]
    if not rows:
        raise FileFormatError("a quantity without a value", where=place)
    whole = replace(
        made,
        values=_joined(rows, "values"),
        units=_joined(rows, "units"),
        unread=next((r.unread for r in rows if r.unread), "") or _region(element),
    )
    if any(row.sigma is None for row in rows):
        return whole
    return replace(whole, sigma=_joined(rows, "sigma"), coverage=_joined(rows, "coverage"))


def _joined(rows: Sequence[Quantity], name: str) -> tuple[Any, ...]:
    return tuple(value for row in rows for value in getattr(row, name))


def _standard(form: Any) -> str:
    """The standard uncertainty of a coverage interval, which versions of D-SI name differently."""
    names = {local(one).removesuffix(_LISTS) for one in form}
    return next((name for name in ("standardUnc", "standardMU", "valueStandardMU") if name in names), "standardUnc")


def _region(element: Any) -> str:
    """Return what is not read of an uncertainty for several dimensions at once; empty where there is none."""
    form = next((local(one) for one in element if "Region" in local(one) or "Multivariate" in local(one)), "")
    return f"uncertainty as {form} is not read" if form else ""


def _spread(stated: Sequence[Any], count: int, what: str, place: str) -> list[Any]:
    """One for each value; a single one holds for all."""
    if len(stated) not in (1, count):
        raise FileFormatError(f"wrong number of {what}", where=place, value=len(stated), limit=f"1 or {count}")
    return list(stated) * (count if len(stated) == 1 else 1)


def _checked(stated: Sequence[float], count: int, place: str) -> tuple[float, ...]:
    spread = _spread(stated, count, "uncertainties", place)
    if min(spread) < 0.0:
        raise FileFormatError("an uncertainty below zero", where=place, value=min(spread))
    return tuple(spread)
