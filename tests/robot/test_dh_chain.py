"""Arms by Denavit-Hartenberg rows: against products of elementary transforms, in both conventions."""

from __future__ import annotations

import numpy as np
import pytest

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, ModelError
from counterflex.files.cell.cell import read_cell
from counterflex.robot.elasticity.chain import ElasticChain, forward
from counterflex.robot.kinematics.inverse import inverse
from counterflex.robot.model.description import Convention, DhRow, Robot

RNG = np.random.default_rng(1)
UR10 = [(0.0, 0.1273, 90.0), (-0.612, 0.0, 0.0), (-0.5723, 0.0, 0.0), (0.0, 0.163941, 90.0), (0.0, 0.1157, -90.0),
        (0.0, 0.0922, 0.0)]  # fmt: skip


def _turn(axis: int, angle: float) -> Float:
    T = np.eye(4)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    T[i, i] = T[j, j] = np.cos(angle)
    T[j, i], T[i, j] = np.sin(angle), -np.sin(angle)
    return T


def _shift(axis: int, length: float) -> Float:
    T = np.eye(4)
    T[axis, 3] = length
    return T


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_forward_is_the_product_of_elementary_transforms(convention: Convention) -> None:
    rows = [
        DhRow(RNG.uniform(-0.5, 0.5), RNG.uniform(-0.5, 0.5), RNG.uniform(-2, 2), RNG.uniform(-1, 1), s)
        for s in (1.0, -1.0, 1.0, 1.0, -1.0, 1.0)
    ]
    q = RNG.uniform(-2.0, 2.0, 6)
    expected = np.eye(4)
    for row, angle in zip(rows, q, strict=True):
        theta = row.sign * angle + row.offset_rad
        if convention == "standard":
            expected = expected @ _turn(2, theta) @ _shift(2, row.d_m) @ _shift(0, row.a_m) @ _turn(0, row.alpha_rad)
        else:
            expected = expected @ _turn(0, row.alpha_rad) @ _shift(0, row.a_m) @ _turn(2, theta) @ _shift(2, row.d_m)
    np.testing.assert_allclose(
        forward(ElasticChain.build(Robot.from_dh("arm", rows, convention)), q), expected, atol=1e-14
    )


def test_ur10_of_the_example_reaches_its_own_poses() -> None:
    chain = read_cell("examples/cells/ur10_ipa_tmac.toml").chain
    np.testing.assert_allclose(
        forward(chain, np.zeros(6))[:3, 3],
        _ur10_at_zero() + np.array([0.0, 0.093, 0.0]),
        atol=1e-12,
    )
    for _ in range(4):
        q = RNG.uniform(-2.0, 2.0, 6)
        q[4] = 1.0
        T = forward(chain, q)
        found = inverse(chain, T, q + 0.05 * RNG.standard_normal(6))
        np.testing.assert_allclose(forward(chain, found.q), T, atol=1e-9)
        np.testing.assert_allclose(found.q, q, atol=1e-6)


def _ur10_at_zero() -> Float:
    """Flange of a UR10 stretched out, base turned by half a turn: x = -(a2 + a3), y = d4 + d6, z = d1 - d5."""
    return np.array([0.612 + 0.5723, 0.163941 + 0.0922, 0.1273 - 0.1157])


def test_bad_rows_are_refused() -> None:
    with pytest.raises(ModelError, match="six axes"):
        Robot.from_dh("arm", [DhRow(0.1, 0.1, 0.0)] * 5)
    with pytest.raises(FileFormatError, match="'axes' cannot be used"):
        read_cell(_five_rows())


def _five_rows() -> str:
    from pathlib import Path
    from tempfile import mkdtemp

    text = Path("examples/cells/ur10_ipa_tmac.toml").read_text(encoding="utf-8")
    head, tail = text.split("[[robot.dh.axes]]\nd_mm = 92.2", 1)
    path = Path(mkdtemp()) / "cell.toml"
    path.write_text(head + tail[tail.index("[[end_effector]]") :], encoding="utf-8")
    return str(path)
