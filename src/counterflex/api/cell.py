"""The cell: read it, ask where its tool is, how far it bends and which of its elements bend."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from counterflex.core import atomic
from counterflex.core.arrays import Float, as_float
from counterflex.core.result import Figure, Result
from counterflex.core.units import DEG, MM, N_PER_MM, UM, UM_PER_KN, URAD_PER_KNM
from counterflex.files.cell import cell as cell_file
from counterflex.path.toolpath import tool_orientation, tool_poses
from counterflex.robot.elasticity import chain as elastic_chain, compliance as cartesian, gravity
from counterflex.robot.kinematics.inverse import inverse_path

if TYPE_CHECKING:
    import polars as pl

_DIRECTIONS: Final = ("tx", "ty", "tz", "rx", "ry", "rz")


class Cell(Result):
    """A robot cell, as its file describes it.

    Attributes:
        model: Robot, end effector, part, tools and material, SI.
    """

    def __init__(self, model: cell_file.Cell) -> None:
        self.model = model

    @property
    def name(self) -> str:
        """Name of the cell."""
        return self.model.name

    @property
    def file(self) -> Path:
        """The cell file."""
        return self.model.path

    @property
    def table(self) -> pl.DataFrame:
        """Compliances of the elastic elements that are not rigid.

        Columns ``element``, ``direction`` (t along, r about an axis of the element), ``compliance`` and ``unit``
        (um/kN, urad/kNm).
        """
        import polars as pl

        chain = self.model.chain
        rows = [
            {
                "element": name,
                "direction": _DIRECTIONS[k],
                "compliance": float(chain.compliance[i, k]) / (UM_PER_KN if k < 3 else URAD_PER_KNM),
                "unit": "um/kN" if k < 3 else "urad/kNm",
            }
            for i, name in enumerate(chain.names)
            for k in range(6)
            if chain.compliance[i, k] > 0.0
        ]
        return pl.DataFrame(
            rows, schema={"element": pl.String, "direction": pl.String, "compliance": float, "unit": str}
        )

    @property
    def summary(self) -> dict[str, Any]:
        """Check of the cell, as ``counterflex cell check --json`` prints it."""
        from counterflex.app.questions import check_cell

        return check_cell(str(self.file))

    def edge_force(self, chip_um: Any) -> Float:
        """Return the force on a millimetre of edge by the force law of the material.

        Args:
            chip_um: (n,) chip thicknesses.

        Returns:
            (n, 3) N/mm: cutting, radial, axial.
        """
        chips = np.atleast_1d(np.asarray(chip_um, dtype=np.float64))
        force: Float = self.model.force_law.edge_force(chips * UM) / N_PER_MM
        return force

    def save(self, file: str | Path) -> Path:
        """Write the cell file; files that it names are named from the new place. Returns where."""
        from counterflex.files.cell.set_up import copied_text

        atomic.write_text(Path(file), copied_text(self.file, Path(file).parent))
        return Path(file)

    def _lines(self) -> list[str]:
        tables = self.model.tables
        tools = ", ".join(f"T{tool.number} D{tool.diameter_mm:g}" for tool in tables.tools) or "none"
        material = "none" if tables.material is None else (tables.material.name or tables.material.catalog)
        return [
            f"{self.model.label}: {self.model.robot.name}",
            f"end effector: {', '.join(body.name for body in tables.end_effector) or 'none'}",
            f"tools: {tools}; material: {material}",
            f"file: {self.file}",
        ]

    def _pictures(self) -> dict[str, Figure]:
        return {"cell": self._drawing}

    def _drawing(self) -> dict[str, Any]:
        from counterflex.app.compensation.cell_facts import drawing_at_part
        from counterflex.report.cell_figure import cell_figure

        return cell_figure(drawing_at_part(self.model))


def read_cell(file: str | Path, *, assume_class: bool = False) -> Cell:
    """Read a cell file.

    Args:
        assume_class: Give axes of unknown stiffness the median of the robot's class.

    Raises:
        FileFormatError: It cannot be read; says what, where and what to do.
        ModelError: Its numbers contradict each other.
    """
    return Cell(cell_file.read_cell(file, assume_class=assume_class))


def model_of(cell: Cell | str | Path) -> cell_file.Cell:
    """Return the cell that is meant, read from its file where a file is given."""
    return cell.model if isinstance(cell, Cell) else cell_file.read_cell(cell)


def file_of(cell: Cell | str | Path) -> Path:
    """Return the file of a cell."""
    return cell.file if isinstance(cell, Cell) else Path(cell)


def forward(cell: Cell | str | Path, joints_deg: Any) -> pl.DataFrame:
    """Return where the tool tip stands for joint angles, without load.

    Args:
        cell: Cell, or cell file.
        joints_deg: (6,) or (n, 6) angles as the controller shows them.

    Returns:
        n rows in the robot base: ``x_mm``, ``y_mm``, ``z_mm``, ``tool_i``, ``tool_j``, ``tool_k`` (unit vector from the
        tip to the spindle).

    Raises:
        InputError: Shapes that do not fit, or angles outside of the joint limits.
    """
    import polars as pl

    chain = model_of(cell).chain
    poses = np.stack([elastic_chain.forward(chain, q) for q in _angles(chain, joints_deg)])
    columns: dict[str, Any] = {f"{axis}_mm": poses[:, k, 3] / MM for k, axis in enumerate("xyz")}
    return pl.DataFrame(columns | {f"tool_{axis}": -poses[:, k, 2] for k, axis in enumerate("ijk")})


def inverse(
    cell: Cell | str | Path,
    at_mm: Any,
    tool: Any = (0.0, 0.0, 1.0),
    *,
    rotation_about_tool_deg: float | None = None,
    branch: str | None = None,
) -> pl.DataFrame:
    """Return joint angles that bring the tool tip to places of the part, without load.

    Args:
        cell: Cell, or cell file.
        at_mm: (3,) or (n, 3) places of the tip in the part frame.
        tool: (3,) or (n, 3) unit vectors from the tip to the spindle, part frame.
        rotation_about_tool_deg: About the tool axis; None is that of the cell file.
        branch: Configuration of the arm (``front up noflip`` ...); None is that of the cell file.

    Returns:
        n rows ``j1_deg`` to ``j6_deg``, as the controller shows them.

    Raises:
        ReachError: A place is out of reach; names it.
    """
    import polars as pl

    known = model_of(cell)
    q = _joints_at(known, _places("at_mm", at_mm), tool, rotation_about_tool_deg, branch)
    shown = np.stack([known.chain.axes.shown(row) for row in q]) / DEG
    return pl.DataFrame({f"j{k + 1}_deg": shown[:, k] for k in range(6)})


def compliance(cell: Cell | str | Path, joints_deg: Any) -> Float:
    """Return the Cartesian compliance at the tool tip, without the finite rotations of :func:`deflection`.

    ``C = sum over elements of J^T c J``: displacement and rotation of the tip, base axes, under force and moment.

    Args:
        cell: Cell, or cell file.
        joints_deg: (6,) or (n, 6) angles as the controller shows them.

    Returns:
        (6, 6) or (n, 6, 6): um/N, um/(N m); urad/N, urad/(N m).

    Raises:
        InputError: Shapes that do not fit, or angles outside of the joint limits.
    """
    chain = model_of(cell).chain
    matrices: Float = np.stack([cartesian.cartesian_compliance(chain, q) for q in _angles(chain, joints_deg)]) / UM
    return matrices[0] if np.ndim(joints_deg) == 1 else matrices


def deflection(cell: Cell | str | Path, at_mm: Any, force_n: Any, *, by_element: bool = False) -> pl.DataFrame:
    """Return how far forces on the tool tip bend the cell, by the elastic model.

    The tool stands along z of the part, in the posture of the cell file.

    Args:
        cell: Cell, or cell file.
        at_mm: (3,) or (n, 3) tool tips in the part frame.
        force_n: (3,) or (n, 3) forces on the tool in part axes.
        by_element: One row for each place and elastic element instead: ``point``, ``element``,
            ``deflection_x_um`` ... of the linear model, and its ``share`` of the whole along the deflection.

    Returns:
        n rows: ``x_mm`` ..., ``fx_n`` ..., ``deflection_x_um`` ... (displacement of the tip in part axes by the force),
        ``sag_x_um`` ... (by own weight).

    Raises:
        InputError: Shapes that do not fit, or a stiffness that is not known.
        ReachError: A point is out of reach.
    """
    import polars as pl

    known = model_of(cell)
    places = _places("at_mm", at_mm)
    forces = np.atleast_2d(np.asarray(force_n, dtype=np.float64))
    forces = as_float("force_n", np.broadcast_to(forces, places.shape) if len(forces) == 1 else forces, places.shape)
    q = _joints_at(known, places)
    R_base_part = known.T_base_part[:3, :3]
    w_base = np.pad(forces @ R_base_part.T, ((0, 0), (0, 3)))
    if by_element:
        return _by_element(known, q, w_base, R_base_part)
    bent = cartesian.deflection(known.chain, q, w_base)[:, :3] @ R_base_part / UM
    sag = gravity.sag(known.chain, q)[:, :3] @ R_base_part / UM
    blocks = (("{}_mm", places), ("f{}_n", forces), ("deflection_{}_um", bent), ("sag_{}_um", sag))
    return pl.DataFrame({name.format(axis): block[:, i] for name, block in blocks for i, axis in enumerate("xyz")})


def _by_element(cell: cell_file.Cell, q: Float, w_base: Float, R_base_part: Float) -> pl.DataFrame:
    import polars as pl

    rows = []
    for point, (joints, wrench) in enumerate(zip(q, w_base, strict=True)):
        parts = cartesian.shares(cell.chain, joints, wrench)[:, :3] @ R_base_part
        whole = parts.sum(axis=0)
        size = float(whole @ whole)
        for name, part in zip(cell.chain.names, parts, strict=True):
            shift = {f"deflection_{axis}_um": float(part[k]) / UM for k, axis in enumerate("xyz")}
            rows.append(
                {"point": point, "element": name, **shift, "share": float(part @ whole) / size if size else 0.0}
            )
    return pl.DataFrame(rows)


def _places(name: str, at_mm: Any) -> Float:
    return as_float(name, np.atleast_2d(np.asarray(at_mm, dtype=np.float64)), (None, 3))


def _angles(chain: elastic_chain.ElasticChain, joints_deg: Any) -> list[Float]:
    """Angles of the model, rad."""
    from counterflex.app.pose_questions import checked_joints

    rows = as_float("joints_deg", np.atleast_2d(np.asarray(joints_deg, dtype=np.float64)), (None, 6))
    return [checked_joints(chain, row.tolist()) for row in rows]


def _joints_at(
    cell: cell_file.Cell,
    places_mm: Float,
    tool: Any = (0.0, 0.0, 1.0),
    rotation_about_tool_deg: float | None = None,
    branch: str | None = None,
) -> Float:
    """Angles of the model, rad, at places of the part."""
    posture = cell.tables.posture
    about = posture.rotation_about_tool_rad if rotation_about_tool_deg is None else rotation_about_tool_deg * DEG
    axes = np.broadcast_to(np.atleast_2d(np.asarray(tool, dtype=np.float64)), places_mm.shape)
    rotation = tool_orientation(as_float("tool", axes, places_mm.shape), about)
    if cell.holds_part:
        from counterflex.geometry import pose

        Ts_base_hand = cell.hand_poses(pose.make(rotation, places_mm * MM))
    else:
        Ts_base_hand = tool_poses(cell.T_base_part, places_mm * MM, rotation)
    return inverse_path(cell.chain, Ts_base_hand, posture.branch if branch is None else branch).q
