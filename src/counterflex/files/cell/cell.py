"""The cell file read and resolved: everything physical the rest of the program stands on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from counterflex.core.arrays import Float
from counterflex.core.errors import FileFormatError, InputError
from counterflex.core.units import DEG, MM, UM
from counterflex.cutting import material
from counterflex.cutting.coefficients import ForceLaw
from counterflex.cutting.cutter import Cutter
from counterflex.cutting.force_laws import ValidFor, built
from counterflex.cutting.stock import BlankBox, HeightMap
from counterflex.cutting.tilted_stock import box_along_tool
from counterflex.files.cell.class_stiffness import (
    ClassDrives,
    ClassStiffness,
    drives_of_class,
    prior_of,
    unknown_axes,
    with_class_stiffness,
)
from counterflex.files.cell.external_axes import moved
from counterflex.files.cell.located import located
from counterflex.files.cell.plausibility import require_units
from counterflex.files.cell.robot_description import calibration_of, robot_of
from counterflex.files.cell.tables import CellTables, MaterialTable, PartTable, StockTable
from counterflex.geometry import pose
from counterflex.plan.process_limits import ProcessLimits
from counterflex.plan.relative_motion import hand_poses
from counterflex.programs.language import StatementForms
from counterflex.programs.robot_writer.machine_functions import MachineFunctions
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.drive_error import DriveErrors
from counterflex.robot.model.calibration import calibrated
from counterflex.robot.model.description import EndEffector, Robot, Segment

KIND = "counterflex-cell"
VERSION = 1


@dataclass(frozen=True, eq=False)
class Cell:
    """A cell: the tables of its file and the objects they describe, in SI."""

    tables: CellTables  # The file as written, in shop units
    path: Path  # Where it was read from; relative paths in the file are relative to its folder
    robot: Robot  # Robot with the file's changes to its elastic elements, and calibrated
    end_effector: EndEffector  # Bodies from the flange outward and the TCP, calibrated
    chain: ElasticChain
    nominal_robot: Robot  # Robot without calibration: the geometry that its controller computes with
    nominal_end_effector: EndEffector  # End effector without calibration
    # What the robot's class gave the axes that no stiffness is known of; None where nothing was asked of it, or where
    # every axis has one
    class_stiffness: ClassStiffness | None = None
    # (3, 3) axes of the working plane in the part frame, whose z is the direction of a tilted tool; None where the tool
    # is along z of the part. Part frame, datum points and blank are given in the plane then.
    R_part_plane: Float | None = None
    # The tool cuts in several directions, or turns while it cuts: a program of five axes, planned in part axes with
    # columns of material
    tool_turns: bool = False

    def with_turning_tool(self) -> Cell:
        """The same cell for a program that cuts in several directions of the tool, or turns it in the cut."""
        return replace(self, tool_turns=True)

    def in_plane(self, R_part_plane: Float) -> Cell:
        """The same cell with the part seen in a working plane.

        A part that the robot holds stays in its own axes, as for a tool that turns: the robot's chain ends in them.

        Args:
            R_part_plane: (3, 3); the origin stays that of the part.
        """
        return self.with_turning_tool() if self.holds_part else replace(self, R_part_plane=R_part_plane)

    @property
    def label(self) -> str:
        """Name of the cell and what in it is only assumed, for the headers of programs."""
        given = self.class_stiffness
        if given is None:
            return self.name
        return f"{self.name[:50]}, stiffness of {given.named} assumed from the robot's class"

    @property
    def name(self) -> str:
        """Name of the cell."""
        return self.tables.name

    @property
    def part(self) -> PartTable:
        """Table ``[part]``. Raises FileFormatError: the file has none."""
        if self.tables.part is None:
            raise self._lacking("[part]")
        return self.tables.part

    @property
    def holds_part(self) -> bool:
        """Return whether the robot holds the part against a standing spindle; the chains then end in the part frame."""
        return self.tables.part_on == "flange"

    @property
    def material(self) -> MaterialTable:
        """Table ``[material]``. Raises FileFormatError: the file has none."""
        if self.tables.material is None:
            raise self._lacking("[material]")
        return self.tables.material

    def missing_for_milling(self) -> tuple[str, ...]:
        """Tables without which nothing can be milled and that the file does not have; calibration needs none of them.

        Returns:
            Some of ``[part]``, ``[part.stock]``, ``[[tools]]``, ``[material]``.
        """
        part = self.tables.part
        return tuple(
            name
            for name, absent in (
                ("[part]", part is None),
                ("[part.stock]", part is not None and part.stock is None),
                ("[[tools]]", not self.tables.tools),
                ("[material]", self.tables.material is None),
            )
            if absent
        )

    def require_milling(self) -> None:
        """Check that the file describes everything that cutting needs.

        Raises:
            FileFormatError: It does not; one line that names every table that is missing.
        """
        missing = self.missing_for_milling()
        if missing:
            raise self._lacking(*missing)

    def _lacking(self, *tables: str) -> FileFormatError:
        named = ", ".join(tables)
        return FileFormatError(
            f"the cell file has no {named}, which this job needs",
            where=str(self.path),
            hint="Only calibration does without; docs/cell-file.md lists the keys",
        )

    @cached_property
    def unknown_axes(self) -> tuple[int, ...]:
        """Numbers 0..5 of the axes that no stiffness is known of and that are taken as rigid."""
        return unknown_axes(self.nominal_robot, self.tables.robot)

    @cached_property
    def bodies_of_unknown_stiffness(self) -> tuple[str, ...]:
        """Names of the bodies beyond the flange that state no compliance (0 states a rigid one): taken as rigid.

        Empty where the end effector is no spindle: a cell without tools, or a robot that holds the part.
        """
        if not self.tables.tools or self.holds_part:
            return ()
        return tuple(body.name for body in self.tables.end_effector if not body.states_compliance)

    @cached_property
    def controller_chain(self) -> ElasticChain:
        """The chain as the robot controller has it, without calibrations; ``chain`` itself where there are none."""
        if not self.tables.robot.calibration:
            return self.chain
        return ElasticChain.build(self.nominal_robot, self.nominal_end_effector)

    @cached_property
    def class_drives(self) -> ClassDrives | None:
        """Drives and play of the robot's class for axes without them; None: nothing is missing, or no class."""
        swings = not self.unknown_axes or self.class_stiffness is not None
        loops = swings and self.tables.dynamics.mode is None
        return drives_of_class(self.chain, self.nominal_robot, self.tables.robot, self.class_stiffness, loops=loops)

    @cached_property
    def planning_chain(self) -> ElasticChain:
        """The chain that a plan is made with: drives, friction and play of the robot's class where it has none."""
        given = self.class_drives
        return self.chain if given is None else given.given_to(self.chain)

    @cached_property
    def calibration(self) -> dict[str, Float]:
        """(6,) m, rad: displacement behind each calibrated segment."""
        return calibration_of(self.tables)

    @cached_property
    def drive_errors(self) -> DriveErrors:
        """Periodic errors and sag of the drives: from controller angles to those of ``chain`` and back."""
        table, sag = self.tables.drive_error, self.tables.axis_sag
        errors = DriveErrors() if table is None else table.errors()
        return errors if sag is None else replace(errors, sag=sag.sag(self.controller_chain))

    @cached_property
    def T_base_part(self) -> Float:
        """(4, 4) part frame (its working plane) in the robot base, as the controller knows it.

        Of external axes, those that carry the robot take the base away from the part, and those that carry the part
        move it: ``T_base_floor T_floor_carried T_zero_part``.

        Raises:
            InputError: The robot holds the part, so that it has no place in the base.
        """
        if self.holds_part:
            raise InputError(
                "this needs a part that stands, and the robot holds it",
                where=str(self.path),
                value='part_on = "flange"',
                limit='part_on = "table"',
                hint="docs/cell-file.md, 'The robot holds the part', lists the commands that take it",
            )
        T_base_part = self.T_base_floor @ moved(self.tables.external_axes, "part") @ self.part.matrix()
        return T_base_part if self.R_part_plane is None else T_base_part @ pose.make(self.R_part_plane)

    @cached_property
    def T_frame_part(self) -> Float:
        """(4, 4) part frame as programs give it: in the robot base, coupled external axes at zero.

        An axis that the controller counts in (``coupled``) carries no frame away: its world stands where it is with the
        axis at zero, and a frame on a positioner goes with that.
        """
        free = tuple(axis for axis in self.tables.external_axes if not axis.coupled)
        T_base_floor = pose.inverse(moved(free, "robot"))
        T_frame_part = T_base_floor @ moved(free, "part") @ self.part.matrix()
        return T_frame_part if self.R_part_plane is None else T_frame_part @ pose.make(self.R_part_plane)

    def at_external(self, values: Mapping[int, float]) -> Cell:
        """The cell with external axes elsewhere.

        Args:
            values: By number of the axis, mm or deg; others stay.
        """
        axes = tuple(
            axis.model_copy(update={
                "at_mm" if axis.kind == "linear" else "at_deg": values.get(int(axis.name[1:]), axis.shown),
                "moves_mm": (), "moves_deg": (), "moves_at_mm": (),
            })
            for axis in self.tables.external_axes
        )  # fmt: skip
        return replace(self, tables=self.tables.model_copy(update={"external_axes": axes}))

    @cached_property
    def T_base_tcp(self) -> Float | None:
        """(4, 4) tool frame of the spindle that stands, in the robot base; None where the robot holds the tool."""
        return self.T_base_floor @ self.tables.tcp.matrix() if self.holds_part else None

    def hand_poses(self, Ts_part_tcp: Float) -> Float:
        """(n, 4, 4) poses of the robot's hand (tool frame, or the part frame it holds) in the base.

        Args:
            Ts_part_tcp: (n, 4, 4) poses of the tool frame in the part.
        """
        T_base_part = np.eye(4) if self.holds_part else self.T_base_part
        return hand_poses(T_base_part, self.T_base_tcp, Ts_part_tcp)

    @cached_property
    def T_base_floor(self) -> Float:
        """(4, 4) the robot base at zero of its external axes, in the robot base where it stands."""
        return pose.inverse(moved(self.tables.external_axes, "robot"))

    @cached_property
    def datum_points_part(self) -> Float:
        """(k, 3) m, points where the robot touched the part to measure its frame."""
        points = np.array(self.part.datum_points_mm, dtype=np.float64).reshape(-1, 3) * MM
        return points if self.R_part_plane is None else points @ self.R_part_plane

    @cached_property
    def force_law(self) -> ForceLaw:
        """Cutting law of the material."""
        return _force_law(self.material, str(self.path))

    def cutter(self, number: int) -> Cutter:
        """The tool with the program's number. Raises FileFormatError: the cell has no such tool, or none at all."""
        if not self.tables.tools:
            raise self._lacking("[[tools]]")
        for tool in self.tables.tools:
            if tool.number == number:
                return Cutter(
                    diameter_m=tool.diameter_mm * MM,
                    corner_radius_m=tool.corner_radius_mm * MM,
                    flutes=tool.flutes,
                    helix_rad=tool.helix_deg * DEG,
                    flute_length_m=tool.flute_length_mm * MM,
                    runout_m=tool.runout_um * UM,
                )
        raise FileFormatError(
            "the program cuts with a tool that the cell does not have",
            where=str(self.path),
            value=f"T{number}",
            limit=", ".join(f"T{tool.number}" for tool in self.tables.tools),
            hint=f"Add a [[tools]] table with number = {number}" if number else "Select a tool in the program: M6 T...",
        )

    @property
    def work_offsets(self) -> dict[str, tuple[float, float, float]]:
        """Zeros of work offsets in the part frame, m."""
        given = {} if self.tables.part is None else self.tables.part.work_offsets_mm
        return {name: (x * MM, y * MM, z * MM) for name, (x, y, z) in given.items()}

    @property
    def tool_names(self) -> dict[str, int]:
        """Number of each tool by its name in capitals; names that two tools have are left out."""
        names = [tool.name.strip().upper() for tool in self.tables.tools]
        return {
            name: tool.number
            for name, tool in zip(names, self.tables.tools, strict=True)
            if name and names.count(name) == 1
        }

    def process_limits(self, number: int) -> ProcessLimits:
        """Return the limits of spindle, robot and tool; a tool that the cell does not have has no length."""
        tool = next((tool for tool in self.tables.tools if tool.number == number), None)
        table = self.tables.process_limits
        return table.limits() if tool is None else table.limits(tool.overhang_mm, tool.modulus_gpa)

    def machine_functions(self, language: str) -> MachineFunctions:
        """Spindle, coolant and tool change in a robot language, from ``[controller.spindle]`` and ``[[tools]]``."""
        if StatementForms.of(language).data_key == "tool_data":
            data = {tool.number: f"{tool.tool_data}" for tool in self.tables.tools if tool.tool_data is not None}
        else:
            data = {tool.number: tool.tooldata for tool in self.tables.tools if tool.tooldata is not None}
        return self.tables.controller.spindle.functions(language, data, str(self.path))

    def blank_box(self) -> BlankBox | None:
        """The blank as a box in the frame of the path; None where it is a mesh or an earlier result."""
        stock = None if self.tables.part is None else self.tables.part.stock
        if stock is None or stock.box_min_mm is None or stock.box_max_mm is None:
            return None
        turn = np.eye(3) if self.R_part_plane is None else self.R_part_plane
        return BlankBox(np.array(stock.box_min_mm) * MM, np.array(stock.box_max_mm) * MM, turn)

    def stock(self) -> HeightMap:
        """A fresh blank in the part frame."""
        if self.part.stock is None:
            raise self._lacking("[part.stock]")
        with located(f"{self.path}: part.stock"):
            return _stock(self.part.stock, self.path.parent, self.R_part_plane)


def read_cell(path: str | Path, *, assume_class: bool = False) -> Cell:
    """Read a cell file and resolve what it names.

    Args:
        assume_class: Give axes that no stiffness is known of the median of the robot's class.

    Raises:
        InputError: With ``assume_class``, a robot whose class says nothing.
        FileFormatError: Missing file, wrong format or version, unknown key, value out of range or by magnitude in
            another unit, unknown robot, segment or material; one line that says where and what to do.
        ModelError: The numbers contradict each other (compliance or mass far outside of what robots are made of).
    """
    file = Path(path)
    cell = resolve(CellTables.read(file, kind=KIND, version=VERSION), file, assume_class=assume_class)
    require_units(cell.tables, str(file))
    return cell


def resolve(tables: CellTables, path: Path, *, assume_class: bool = False) -> Cell:
    """Build the objects of a cell from its tables. Raises as :func:`read_cell`."""
    where = str(path)
    robot = robot_of(tables, path)
    given = None
    if assume_class and (axes := unknown_axes(robot, tables.robot)):
        with located(f"{where}: robot"):
            given = ClassStiffness(axes, prior_of(robot, tables.robot))
        robot = with_class_stiffness(robot, given)
    taken = {segment.name for segment in robot.segments}
    for body in tables.end_effector:
        if body.name in taken:
            raise FileFormatError(
                "a body of the end effector has the name of a segment of the robot",
                where=f"{where}: end_effector",
                value=body.name,
                hint="Give it another name",
            )
    bodies = tuple(
        Segment(
            name=body.name,
            T_prev_seg=body.matrix(),
            compliance=body.over(np.zeros(6)),
            mass_kg=body.mass_kg,
            p_seg_com=np.array([body.com_x_mm, body.com_y_mm, body.com_z_mm]) * MM,
        )
        for body in tables.end_effector
    )
    hand = tables.part if tables.part_on == "flange" and tables.part is not None else tables.tcp
    end_effector = EndEffector(bodies, hand.matrix())
    true_robot, true_end_effector = robot, end_effector
    if tables.robot.calibration:
        with located(f"{where}: robot.calibration"):
            true_robot, true_end_effector = calibrated(robot, end_effector, calibration_of(tables))
    with located(where):
        chain = ElasticChain.build(true_robot, true_end_effector)
        cell = Cell(tables, path, true_robot, true_end_effector, chain, robot, end_effector, given)
    if tables.material is not None:
        with located(f"{where}: material"):
            _ = cell.force_law
    with located(f"{where}: {'drive_error' if tables.drive_error is not None else 'axis_sag'}"):
        _ = cell.drive_errors
    for tool in tables.tools:
        with located(f"{where}: tool T{tool.number}"):
            cell.cutter(tool.number)
    return cell


def _force_law(table: MaterialTable, where: str) -> ForceLaw:
    if table.catalog is not None:
        with located(f"{where}: material.catalog"):
            return material.load(table.catalog).with_ratios(kr_over_kc=table.kr_over_kc, ka_over_kc=table.ka_over_kc)
    h_min, h_max = table.chip_min_um * UM, table.chip_max_um * UM
    if h_min >= h_max:
        raise FileFormatError(
            "chip_min_um is not below chip_max_um",
            where=f"{where}: material",
            value=f"{table.chip_min_um:g} and {table.chip_max_um:g}",
        )
    with located(f"{where}: material.law"):
        return built(table.law, table.law_values(), ValidFor(h_min, h_max, table.source, "cell file"))


def _stock(table: StockTable, folder: Path, R_part_plane: Float | None) -> HeightMap:
    cell_m = table.cell_mm * MM
    if R_part_plane is not None:
        if table.box_min_mm is None or table.box_max_mm is None:
            raise FileFormatError(
                "only a blank that is a box can be cut with a tilted tool",
                value="stl" if table.stl is not None else "result",
                limit="box_min_mm and box_max_mm",
                hint="Give the box around what the tool meets",
            )
        return box_along_tool(np.array(table.box_min_mm) * MM, np.array(table.box_max_mm) * MM, cell_m, R_part_plane)
    if table.box_min_mm is not None and table.box_max_mm is not None:
        low, high = ((x * MM, y * MM, z * MM) for x, y, z in (table.box_min_mm, table.box_max_mm))
        return HeightMap.from_box(low, high, cell_m)
    if table.stl is not None:
        return HeightMap.from_stl(folder / table.stl, cell_m)
    return HeightMap.load(folder / str(table.result))
