"""Weighted residuals of measurements, in blocks of like rows, with exact derivatives."""

from __future__ import annotations

from typing import Protocol

from counterflex.core.arrays import Bool, Float, Int


class Residuals(Protocol):
    """A block of measurements of one kind.

    A row is what can be wrong as a whole (one pose, one pull, one touched point): outliers are judged, and data are
    held out, by row. The components of a row are its numbers, each divided by its standard deviation.

    Attributes:
        name: For messages: ``tracker poses``, ``ball bar``.
        group: (rows,) id that keeps rows together when data are held out (the same pose, cut or pull); ids are shared
            between the blocks of one identification.
        components: Names of a row's numbers, with unit: ``("x m", "y m", "z m")``.
        sigma: (rows, components) standard deviations in these units.
    """

    @property
    def name(self) -> str:
        """See the class."""

    @property
    def group(self) -> Int:
        """See the class."""

    @property
    def components(self) -> tuple[str, ...]:
        """See the class."""

    @property
    def sigma(self) -> Float:
        """See the class."""

    def evaluate(self, x: Float) -> Float:
        """Weighted residuals ``(measured - predicted) / sigma``.

        ``x``: (p,) values of all parameters, SI, in the order of the identification's parameters.

        Returns:
            (rows, components), dimensionless.
        """

    def jacobian(self, x: Float) -> Float:
        """(rows, components, p) derivative of :meth:`evaluate` by every parameter."""

    def subset(self, rows: Bool) -> Residuals:
        """The block with the marked rows only."""
