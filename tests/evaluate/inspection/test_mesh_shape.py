"""Distances to a CAD mesh do not depend on how finely it is divided, and are those of the solid."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from counterflex.core.units import MM
from counterflex.evaluate.inspection.mesh_shape import MeshShape

SIZE = np.array([40.0, 30.0, 20.0])
REACH = 5.0


@pytest.mark.parametrize("divided", [0, 4, 6])
def test_a_box_has_its_distances_however_fine_its_triangles(divided: int) -> None:
    """12, 3072 and 49152 triangles, against the closed form of a box."""
    mesh = trimesh.creation.box(bounds=[np.zeros(3), SIZE])
    for _ in range(divided):
        mesh = mesh.subdivide()
    shape = MeshShape(mesh.vertices * MM, mesh.faces, REACH * MM)
    points = np.random.default_rng(1).uniform(-8.0, SIZE + 8.0, (20_000, 3))
    outside = np.maximum(np.maximum(-points, points - SIZE), 0.0)
    away = np.linalg.norm(outside, axis=1)
    inside = np.minimum(points, SIZE - points).min(axis=1)
    true = np.where(away > 0.0, -away, inside)
    got = shape.distance(points * MM) / MM
    near = np.abs(true) < REACH - 1e-6
    np.testing.assert_allclose(got[near], true[near], atol=1e-8)
    assert np.isnan(got[np.abs(true) > REACH + 1e-6]).all()
