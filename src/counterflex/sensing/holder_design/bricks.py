"""Linear elasticity of a body made of bricks: a graded grid of which cells are left out, with quadratic elements.

Serendipity bricks of 20 nodes carry bending without locking. One face (z = 0) is clamped, the opposite one moves as a
rigid body: its six unit motions give the stiffness of the body at its tip, and the strain everywhere for each of them.
Assembly and elements are scikit-fem's (ADR 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from counterflex.core.arrays import Bool, Float, as_positive
from counterflex.core.errors import InputError
from counterflex.geometry.rotation import skew


@dataclass(frozen=True, eq=False)
class Bricks:
    """A body on a grid."""

    x: Float  # (nx + 1,) m, planes of the grid, increasing
    y: Float  # (ny + 1,) m, likewise
    z: Float  # (nz + 1,) m, likewise; the first is clamped, the last moves as a rigid body
    filled: Bool  # (nx, ny, nz) cells that are material

    def __post_init__(self) -> None:
        """Check that it is a body that can be clamped and loaded.

        Raises InputError: planes that do not increase, a mask of another shape, or an end without material.
        """
        for name, planes in (("x", self.x), ("y", self.y), ("z", self.z)):
            if len(planes) < 2 or np.any(np.diff(planes) <= 0.0):
                raise InputError(f"planes of the grid along {name} do not increase", value=len(planes), limit=">= 2")
        shape = (len(self.x) - 1, len(self.y) - 1, len(self.z) - 1)
        if self.filled.shape != shape:
            raise InputError("cells of the body", value=self.filled.shape, limit=shape)
        if not (np.any(self.filled[:, :, 0]) and np.any(self.filled[:, :, -1])):
            raise InputError("the body has no material at its clamped or its loaded end")

    @property
    def count(self) -> int:
        """Cells that are material."""
        return int(np.sum(self.filled))


@dataclass(frozen=True, eq=False)
class Solved:
    """The body under the six unit motions of its loaded face, about the point of its plane at x = y = 0."""

    stiffness: Float  # (6, 6) N/m, N, N m: wrench on the loaded face by its motion
    unknowns: int  # of the system that was solved
    _basis: Any
    _motion: Float

    def strain(self, points: Float) -> Float:
        """Strain at points of the body.

        ``points``: (k, 3) m, inside of the body; on a face between cells their mean. Returns (k, 3, 3, 6) strain tensor
        for each unit motion. Raises InputError: a point outside of the body.
        """
        basis, mesh = self._basis, self._basis.mesh
        low, high = mesh.p[:, mesh.t].min(axis=1), mesh.p[:, mesh.t].max(axis=1)
        at = points.T[:, :, None]
        inside = np.all((at >= low[:, None] - 1e-9) & (at <= high[:, None] + 1e-9), axis=0)
        within = inside.any(axis=1)
        if not np.all(within):
            where = points[int(np.argmin(within))]
            raise InputError("a strain is asked for outside of the body", value=(1e3 * where).round(3).tolist())
        of_point, cells = np.nonzero(inside)
        local = basis.mapping.invF(at[:, of_point], tind=cells)
        shapes = [basis.elem.gbasis(basis.mapping, local, j, tind=cells)[0].grad[:, :, 0] for j in range(basis.Nbfun)]
        nodes = basis.element_dofs[:, cells]
        gradient = np.einsum("jdk,jknm->kndm", np.stack(shapes), self._motion[nodes])
        out: Float = np.zeros((len(points), 3, 3, 6))
        np.add.at(out, of_point, 0.5 * (gradient + np.swapaxes(gradient, 1, 2)))
        out /= np.sum(inside, axis=1)[:, None, None, None]
        return out


@dataclass(frozen=True, eq=False)
class MirroredBody:
    """A solved body mirrored at the plane x = 0 of its own frame: ``u'(Sx) = S u(x)``, S = diag(-1, 1, 1)."""

    original: Solved  # the body that was solved

    @property
    def stiffness(self) -> Float:
        """(6, 6) as of :class:`Solved`: forces mirror with S, moments with -S."""
        out: Float = _MIRRORED[:, None] * self.original.stiffness * _MIRRORED
        return out

    @property
    def unknowns(self) -> int:
        """Of the system that was solved for both."""
        return 0

    def strain(self, points: Float) -> Float:
        """Strain at points of the mirrored body, as of :class:`Solved`."""
        s = _MIRRORED[:3]
        out: Float = self.original.strain(points * s) * s[:, None, None] * s[:, None] * _MIRRORED
        return out


_MIRRORED: Float = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])


def solve(body: Bricks, e_pa: float, poisson_ratio: float) -> Solved:
    """Solve a body for the six unit motions of its loaded face.

    ``a(u, v) = integral lambda tr eps(u) tr eps(v) + 2 mu eps(u) : eps(v)``, u = 0 at the first plane of z, and ``u = t
    + theta x p`` at the last one. Raises InputError: a material constant out of range, or a body that falls apart.
    """
    from skfem import Basis, ElementHexS2, MeshHex

    as_positive("youngs modulus", e_pa)
    if not 0.0 <= poisson_ratio < 0.5:
        raise InputError("Poisson's ratio", value=poisson_ratio, limit="0 .. 0.5")
    grid = MeshHex.init_tensor(body.x, body.y, body.z)
    mids = grid.p[:, grid.t].mean(axis=1)
    at = [np.searchsorted(planes, mids[k]) - 1 for k, planes in enumerate((body.x, body.y, body.z))]
    basis = Basis(grid.restrict(np.flatnonzero(body.filled[at[0], at[1], at[2]])), ElementHexS2(), intorder=4)
    K = _stiffness(basis, e_pa, poisson_ratio)
    height = basis.doflocs[2]
    fixed = np.flatnonzero(np.abs(height - body.z[0]) < 1e-9)
    moved = np.flatnonzero(np.abs(height - body.z[-1]) < 1e-9)
    held = (3 * np.concatenate([fixed, moved])[:, None] + np.arange(3)).ravel()
    free = np.setdiff1d(np.arange(K.shape[0]), held)
    arm = basis.doflocs[:, moved].T - np.array([0.0, 0.0, body.z[-1]])
    motion = np.zeros((K.shape[0] // 3, 3, 6))
    motion[moved, :, :3] = np.eye(3)
    motion[moved, :, 3:] = -np.stack([skew(a) for a in arm])
    flat = motion.reshape(-1, 6)
    try:
        factor = scipy.sparse.linalg.splu(
            K[free][:, free].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}
        )
    except RuntimeError as fault:
        raise InputError("the body falls apart: a piece of it is held by nothing", value=str(fault)) from fault
    flat[free] = factor.solve(-(K @ flat)[free])
    stiffness: Float = flat.T @ (K @ flat)
    if not (np.all(np.isfinite(stiffness)) and stiffness[2, 2] > 1e-9 * e_pa * body.z[-1]):
        raise InputError("the body falls apart: a piece of it is held by nothing")
    return Solved(0.5 * (stiffness + stiffness.T), len(free), basis, motion)


def _stiffness(basis: Any, e_pa: float, poisson_ratio: float) -> Any:
    """Stiffness matrix over three unknowns per node, from the gradients of the scalar shape functions."""
    lam = e_pa * poisson_ratio / ((1.0 + poisson_ratio) * (1.0 - 2.0 * poisson_ratio))
    mu = 0.5 * e_pa / (1.0 + poisson_ratio)
    gradient = np.stack([basis.basis[j][0].grad for j in range(basis.Nbfun)])  # (j, d, cell, point)
    n, _, cells, points = gradient.shape
    rows = np.ascontiguousarray(np.transpose(gradient, (2, 0, 1, 3))).reshape(cells, 3 * n, points)
    products = (rows * basis.dx[:, None, :]) @ np.swapaxes(rows, 1, 2)
    G = products.reshape(cells, n, 3, n, 3)
    local = lam * G + mu * np.swapaxes(G, 2, 4)
    local += mu * np.einsum("cidjd->cij", G)[:, :, None, :, None] * np.eye(3)[None, None, :, None, :]
    places = (3 * basis.element_dofs.T[:, :, None] + np.arange(3)).reshape(cells, 3 * n)
    i, j = np.repeat(places, 3 * n, axis=1).ravel(), np.tile(places, (1, 3 * n)).ravel()
    size = 3 * basis.N
    return scipy.sparse.coo_matrix((local.reshape(cells, -1).ravel(), (i, j)), shape=(size, size)).tocsr()
