"""Record of a simulated run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from counterflex.core.arrays import Bool, Float, Int
from counterflex.cutting.stock import HeightMap
from counterflex.geometry import rotation
from counterflex.path.toolpath import Run, ToolPath
from counterflex.twin.plant.controller import CommandedReference
from counterflex.twin.plant.turning.column_material import ColumnMaterial


@dataclass(frozen=True, eq=False)
class Record(Run):
    """A simulated run, one row per interpolation cycle of the controller, with what nobody could measure.

    Stretches through air that were skipped leave gaps in ``time_s``. Forces are means over the cycle that begins at
    the row, on the tool, about the tool tip. Positions, tilt and forces are in the frame of the part as it truly lies,
    set-points in the controller's part frame.
    """

    row: Int  # (n,) row of the tool path being run
    engaged: Bool  # (n,) whether the tool removes material
    q_ref: Float  # (n, 6) rad
    # the as-machined height map in the part frame; of a tool that turned the highest material of each column
    stock: HeightMap
    T_base_part: Float  # (4, 4) where the part truly lies
    # (k, 3) m, what the rigid fit to the touched datum points leaves, base axes; (0, 3) when the part frame was not
    # touched
    datum_residual_m: Float
    columns: ColumnMaterial | None = None  # the part as a tool that turned has left it; None of one along z of the part


@dataclass(frozen=True, eq=False)
class SimulatedCycles:
    """Cycles of the controller that were simulated; m rows."""

    k: Int  # (m,) number of the cycle
    time_s: Float  # (m,) controller time
    p_base_tcp: Float  # (m, 3) m, tool tip
    R_base_tcp: Float  # (m, 3, 3)
    q_ref: Float  # (m, 6) rad
    q_motor: Float  # (m, 6) rad
    sums: Float  # (m, 9) of the process over the cycle, see Process

    def record(
        self,
        path: ToolPath,
        reference: CommandedReference,
        Rs_part_command: Float,
        stock: HeightMap | ColumnMaterial,
        T_base_part: Float,
        datum_residual_m: Float,
        T_base_tcp: Float | None = None,
    ) -> Record:
        """The record of a program from its simulated cycles.

        Args:
            path: Tool path of the program.
            reference: Interpolated by the controller, one row per cycle.
            Rs_part_command: (m, 3, 3) commanded orientation of the tool in those cycles.
            T_base_part: (4, 4) where the part truly lies.
            datum_residual_m: See :class:`Record`.
            T_base_tcp: (4, 4) tool frame of a spindle that stands, where the poses of ``self`` are those of the part.
        """
        k, sums = self.k, self.sums
        if T_base_tcp is None:
            Rs_part_tcp = T_base_part[:3, :3].T @ self.R_base_tcp
            p_part: Float = (self.p_base_tcp - T_base_part[:3, 3]) @ T_base_part[:3, :3]
        else:
            Rs_part_base = np.swapaxes(self.R_base_tcp, -1, -2)
            Rs_part_tcp = Rs_part_base @ T_base_tcp[:3, :3]
            p_part = (Rs_part_base @ (T_base_tcp[:3, 3] - self.p_base_tcp)[..., None])[..., 0]
        tilt = rotation.log(Rs_part_tcp @ np.swapaxes(Rs_part_command, -1, -2))
        calls = np.maximum(sums[:, 8:9], 1.0)
        source = reference.source[k]
        run_length = np.cumsum(
            np.linalg.norm(np.diff(reference.p_part_command, axis=0, prepend=path.p_part_tcp[:1]), axis=1)
        )
        return Record(
            time_s=self.time_s,
            row=source,
            motion=path.motion[source],
            progress=run_length[k] / max(run_length[-1], 1e-12),
            kind=path.kind[source],
            p_part_command=reference.p_part_command[k],
            p_part_tcp=p_part,
            tilt_part=tilt,
            axis_part=-Rs_part_tcp[:, :, 2],
            force_part=sums[:, :3] / calls,
            moment_part=sums[:, 3:6] / calls,
            force_peak_n=sums[:, 6],
            depth_m=sums[:, 7],
            engaged=np.array(sums[:, 7] > 0.0),
            q_ref=self.q_ref,
            q_motor=self.q_motor,
            stock=stock if isinstance(stock, HeightMap) else stock.tops(),
            T_base_part=T_base_part,
            datum_residual_m=datum_residual_m,
            columns=None if isinstance(stock, HeightMap) else stock,
        )
