"""A groove whose tool is off by a known error, and the scan of its part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from counterflex.core.arrays import Float, Int
from counterflex.core.units import MM
from counterflex.cutting.cutter import Cutter
from counterflex.evaluate.inspection.part_deviations import FLOOR, WALL, PartDeviations
from counterflex.evaluate.path_error.contacts import Contacts, Nodes, contacts_of, nodes_of
from counterflex.path.toolpath import FEED, RAPID, ToolPath

LENGTH_M = 60.0 * MM
RADIUS_M = 8.0 * MM


def straight_path(length_m: float = LENGTH_M, step_m: float = 0.25 * MM) -> ToolPath:
    """Down by a rapid, then along x at y = z = 0 with 25 mm/s."""
    x = np.concatenate([[0.0], np.arange(0.0, length_m + 0.5 * step_m, step_m)])
    n = len(x)
    p = np.column_stack([x, np.zeros(n), np.zeros(n)])
    p[0, 2] = 20.0 * MM
    kind = np.full(n, FEED)
    kind[:2] = RAPID
    whole = np.ones(n, dtype=np.int64)
    return ToolPath(
        p, np.tile([0.0, 0.0, 1.0], (n, 1)), kind, np.full(n, 0.025), np.full(n, 1361.0),
        np.concatenate([[0.0], x[1:] / 0.025]), whole * 0, whole,
    )  # fmt: skip


def places(rng: np.random.Generator, pitch_m: float = 0.6 * MM) -> tuple[Float, Float, Int]:
    """Places on the floor and both walls of the groove, with normals and faces."""
    x = np.arange(2.0 * MM, LENGTH_M - 2.0 * MM, pitch_m)
    y = np.arange(-7.0 * MM, 7.1 * MM, 1.0 * MM)
    floor = np.stack([*np.meshgrid(x, y, indexing="ij"), np.zeros((len(x), len(y)))], axis=-1).reshape(-1, 3)
    high = np.array([1.0, 3.0, 5.0]) * MM
    wall = np.stack(np.meshgrid(x, [1.0, -1.0], high, indexing="ij"), axis=-1).reshape(-1, 3)
    normal = np.column_stack([0.0 * wall[:, 1], -wall[:, 1], 0.0 * wall[:, 1]])
    wall[:, 1] *= RADIUS_M
    points = np.concatenate([floor, wall])
    normals = np.concatenate([np.tile([0.0, 0.0, 1.0], (len(floor), 1)), normal])
    face = np.concatenate([np.full(len(floor), FLOOR), np.full(len(wall), WALL)])
    order = rng.permutation(len(points))
    return points[order], normals[order], face[order]


@dataclass(frozen=True)
class Groove:
    """A groove and a way to scan it with its tool off by an error (k, 3) m at the nodes."""

    path: ToolPath
    nodes: Nodes
    contacts: Contacts
    scan: Callable[..., PartDeviations]


@pytest.fixture(scope="session")
def mill() -> Cutter:
    return Cutter(diameter_m=2.0 * RADIUS_M, flutes=3)


@pytest.fixture(scope="session")
def groove(mill: Cutter) -> Groove:
    path = straight_path()
    nodes = nodes_of(path)
    points, normals, face = places(np.random.default_rng(5))
    contacts = contacts_of(path, nodes, lambda _: mill, points, normals, 1.0 * MM)

    def scan(error_m: Float, noise_m: float, seed: int) -> PartDeviations:
        rng = np.random.default_rng(seed)
        noise = noise_m * rng.standard_normal(len(points))
        sigma = np.full(len(points), max(noise_m, 1e-6))
        return PartDeviations(points, normals, contacts.left_on(error_m) + noise, sigma, face)

    return Groove(path, nodes, contacts, scan)
