"""The blank's faces as datum faces: planes, and where on them the program leaves them alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float
from counterflex.core.errors import InputError
from counterflex.core.units import MM
from counterflex.cutting.stock import HeightMap

NAMES: Final = ("x-", "x+", "y-", "y+", "bottom", "top")
"""Faces of the blank by the side that they look to, part frame."""
MARGIN_M: Final = 1.0 * MM
"""Strip along the edges of a face that is left out: burrs, chamfers, rounding by the scanner."""
LEAST_AREA_M2: Final = 25.0 * MM * MM


@dataclass(frozen=True, eq=False)
class DatumFaces:
    """Planes about the blank."""

    low: Float  # (3,) m, lowest corner of the blank, part frame
    high: Float  # (3,) m, highest corner
    # by name (rows, columns): where on its grid of cells the face is not machined. Sides: cells along the side by cells
    # in height; bottom and top: the cells of the height map
    whole: dict[str, Bool]
    masks: dict[str, Bool]  # the same without a strip along the edges
    cell_m: float  # side of a cell

    def plane(self, name: str) -> tuple[Float, float]:
        """Outward unit normal (3,) and distance ``n . p`` of a face, m."""
        k = NAMES.index(name)
        normal = np.zeros(3)
        normal[k // 2] = 1.0 if k % 2 else -1.0
        corner = self.high if k % 2 else self.low
        return normal, float(normal @ corner)

    def on(self, name: str, points: Float, *, edges: bool = False) -> Bool:
        """Return whether the feet of points lie on the free part of a face.

        Args:
            points: (n, 3) m, part frame.
            edges: The strip along the edges counts too.
        """
        axis = NAMES.index(name) // 2
        mask = (self.whole if edges else self.masks)[name]
        rows, columns = ((2, 1), (2, 0), (1, 0))[axis]
        j = np.floor((points[:, rows] - self.low[rows]) / self.cell_m).astype(np.int64)
        i = np.floor((points[:, columns] - self.low[columns]) / self.cell_m).astype(np.int64)
        inside = (j >= 0) & (i >= 0) & (j < mask.shape[0]) & (i < mask.shape[1])
        out: Bool = inside & mask[np.clip(j, 0, mask.shape[0] - 1), np.clip(i, 0, mask.shape[1] - 1)]
        return out

    def samples(self, name: str, pitch_m: float) -> Float:
        """(n, 3) m, points on the free part of a face, on a grid about so wide."""
        axis = NAMES.index(name) // 2
        rows, columns = ((2, 1), (2, 0), (1, 0))[axis]
        step = max(1, round(pitch_m / self.cell_m))
        j, i = np.nonzero(self.masks[name][step // 2 :: step, step // 2 :: step])
        out = np.empty((len(j), 3))
        out[:, rows] = self.low[rows] + (step // 2 + j * step + 0.5) * self.cell_m
        out[:, columns] = self.low[columns] + (step // 2 + i * step + 0.5) * self.cell_m
        normal, distance = self.plane(name)
        out[:, axis] = distance * normal[axis]
        return out

    def free(self) -> tuple[str, ...]:
        """Faces of which at least 25 mm2 are not machined."""
        return tuple(name for name in NAMES if self.masks[name].sum() * self.cell_m**2 >= LEAST_AREA_M2)

    def chosen(self, names: str | None) -> tuple[str, ...]:
        """Faces by their names, separated by commas; None: all that are free.

        Raises:
            InputError: An unknown name, or a face that the program machines.
        """
        free = self.free()
        if names is None:
            return free
        chosen = tuple(dict.fromkeys(name.strip() for name in names.split(",") if name.strip()))
        for name in chosen:
            if name not in NAMES:
                raise InputError("no such datum face", where="--datum", value=name, limit=", ".join(NAMES))
            if name not in free:
                raise InputError(
                    "the program machines this face, so that it cannot be a datum face",
                    where="--datum",
                    value=name,
                    limit=", ".join(free) or "no face is left alone",
                )
        if not chosen:
            raise InputError("no datum face is named", where="--datum", limit=", ".join(free))
        return chosen


def datum_faces(stock: HeightMap, nominal: HeightMap) -> DatumFaces:
    """The planes about a blank and where the program leaves them alone.

    Args:
        stock: Before machining.
        nominal: After the undisturbed program; same grid.
    """
    cell = stock.cell_m
    ny, nx = stock.z.shape
    low = np.array([stock.x0_m - 0.5 * cell, stock.y0_m - 0.5 * cell, stock.bottom_m])
    top = float(stock.z.max())
    high = np.array([low[0] + nx * cell, low[1] + ny * cell, top])
    still = nominal.z > top - 1e-6
    levels = low[2] + (np.arange(max(1, int(np.ceil((top - low[2]) / cell)))) + 0.5) * cell
    edges = {"x-": nominal.z[:, 0], "x+": nominal.z[:, -1], "y-": nominal.z[0], "y+": nominal.z[-1]}
    whole = {"x-": stock.z[:, 0], "x+": stock.z[:, -1], "y-": stock.z[0], "y+": stock.z[-1]}
    masks = {name: levels[:, None] < heights[None, :] for name, heights in edges.items()}
    for name, heights in whole.items():
        masks[name] &= (heights > low[2] + 1e-6)[None, :]
    masks["bottom"] = stock.z > low[2] + 1e-6
    masks["top"] = still
    margin = round(MARGIN_M / cell)
    inner = {name: _inner(mask, margin) for name, mask in masks.items()}
    return DatumFaces(low, high, masks, inner, cell)


def _inner(mask: Bool, margin: int) -> Bool:
    """A mask without a strip along its edges, those of the whole face included."""
    if not mask.any():
        return mask
    padded = np.pad(mask, 1)
    distance = scipy.ndimage.distance_transform_cdt(padded, "chessboard")[1:-1, 1:-1]
    out: Bool = distance > margin
    return out
