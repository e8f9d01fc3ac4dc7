"""Pockets across wide cheeks against a plane-strain model of the whole holder, converged by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse.linalg
from skfem import Basis, ElementQuad2, ElementVector, MeshQuad
from skfem.models.elasticity import lame_parameters, linear_elasticity

from counterflex.core.arrays import Float
from counterflex.sensing.holder_design.drawing import Drawing, Pocket
from counterflex.sensing.holder_design.places import behaviour, gain_by_pocket
from counterflex.sensing.strain_holder import HolderBeam

THICK, LENGTH, APART, TIP, AT = 15.0, 180.0, 160.0, (70.0, 420.0), 40.0  # mm; AT: place of the pocket along the cheek
GAUGE, E_PA, NU = 3.0, 210e9, 0.3


def _graded(length: float, finest: float, largest: float) -> Float:
    """Steps that grow by a quarter from the pocket on, mm."""
    ends, step = [0.0], finest
    while ends[-1] < length:
        ends.append(ends[-1] + step)
        step = min(1.25 * step, largest)
    return np.array(ends) * length / ends[-1]


def _cheek(height: float, depth: float, finest: float, *, cut: bool) -> tuple[Float, Float]:
    """(3, 3) stiffness of a cheek's end (x, z, turn about y), and (3,) strain under the gauge by these motions."""
    low, high, floor = AT - height / 2, AT + height / 2, THICK / 2 - depth
    inside = np.linspace(low, high, round(height / finest) + 1)
    z = np.concatenate([low - _graded(low, finest, 2.0)[:0:-1], inside, high + _graded(LENGTH - high, finest, 2.0)[1:]])
    wall = floor - _graded(floor + THICK / 2, finest, 1.5)[::-1]
    x = np.concatenate([wall, np.linspace(floor, THICK / 2, round(depth / finest) + 1)[1:]])
    mesh = MeshQuad.init_tensor(x, z)
    mid = mesh.p[:, mesh.t].mean(axis=1)
    if cut:
        mesh = mesh.restrict(np.flatnonzero(~((np.abs(mid[1] - AT) < height / 2) & (mid[0] > floor))))
    basis = Basis(mesh, ElementVector(ElementQuad2()), intorder=4)
    K = linear_elasticity(*lame_parameters(E_PA, NU)).assemble(basis).tocsr()
    component = np.zeros(K.shape[0], dtype=int)
    for dofs in (basis.nodal_dofs, basis.facet_dofs, basis.interior_dofs):
        for k in range(dofs.shape[0]):
            component[dofs[k]] = k % 2
    at_x, at_z = basis.doflocs
    base, end = np.flatnonzero(np.abs(at_z) < 1e-9), np.flatnonzero(np.abs(at_z - LENGTH) < 1e-9)
    U = np.zeros((K.shape[0], 3))
    U[end[component[end] == 0], 0] = 1.0
    U[end[component[end] == 1], 1] = 1.0
    U[end[component[end] == 1], 2] = -at_x[end[component[end] == 1]]
    held = np.concatenate([base, end])
    free = np.setdiff1d(np.arange(K.shape[0]), held)
    U[free] = scipy.sparse.linalg.splu(K[free][:, free].tocsc()).solve(-(K[free][:, held] @ U[held]))
    face = (floor if cut else THICK / 2) - 1e-7
    probe = basis.probes(np.array([[face, face], [AT - GAUGE / 2, AT + GAUGE / 2]]))
    along = np.array([probe @ U[:, k] for k in range(3)])[:, 2:]
    return U.T @ (K @ U), (along[:, 1] - along[:, 0]) / GAUGE


def _strain(height: float, depth: float, finest: float, *, cut: bool) -> float:
    """Strain under the gauge of one of two mirrored cheeks by a force along x at the tool tip."""
    k, strain = _cheek(height, depth, finest, cut=cut)
    mirror = np.diag([-1.0, 1.0, -1.0])
    to_end = [np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -side * APART / 2], [0.0, 0.0, 1.0]]) for side in (1, -1)]
    ring = sum(A.T @ s @ A for A, s in zip(to_end, (k, mirror @ k @ mirror), strict=True))
    return float(strain @ to_end[0] @ np.linalg.solve(ring, np.array([1.0, 0.0, TIP[1] - LENGTH])))


def plane_gain(height: float, depth: float, finest: float) -> float:
    """Bridge reading, ``eps_z / (1 + nu)``, by the strain of a beam, ``eps_z / (1 - nu^2)`` of the plain cheek."""
    plain = _strain(height, depth, finest, cut=False) / (1.0 - NU**2)
    return _strain(height, depth, finest, cut=True) / (1.0 + NU) / plain


@pytest.mark.by_turn
@pytest.mark.parametrize(("height", "depth"), [(6.0, 4.0), (6.0, 8.0), (12.0, 8.0)])
def test_the_plane_model_has_converged(height: float, depth: float) -> None:
    assert plane_gain(height, depth, 0.5) == pytest.approx(plane_gain(height, depth, 0.25), rel=5e-3)


@pytest.mark.long
@pytest.mark.parametrize("depth", [4.0, 8.0])
def test_what_is_left_is_less_than_what_the_last_refinement_changed(depth: float) -> None:
    """At the default of four bricks; the cheek is eight times as wide as thick, so that plane strain is near."""
    pocket = Pocket(1, True, 0.0, AT / 1e3, 0.116, 0.006, depth / 1e3, 0.0)
    drawing = Drawing(
        HolderBeam(LENGTH / 1e3, APART / 1e3, THICK / 1e3, 0.118),
        (pocket, replace(pocket, side=-1)),
        (TIP[0] / 1e3, 0.0, TIP[1] / 1e3),
    )
    half, full = (float(gain_by_pocket(drawing, behaviour(drawing, 0.03, bricks=n))[0]) for n in (2, 4))
    true = plane_gain(6.0, depth, 0.25)
    assert full == pytest.approx(true, rel=0.05)
    assert abs(full - true) < abs(full - half)
