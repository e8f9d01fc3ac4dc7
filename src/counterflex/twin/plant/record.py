"""What a simulated run leaves behind."""

from __future__ import annotations

from dataclasses import dataclass

from counterflex.core.arrays import Bool, Float, Int
from counterflex.cutting.stock import HeightMap


@dataclass(frozen=True)
class Record:
    """A machined program, one row per interpolation cycle of the controller.

    Stretches through air that were skipped leave gaps in ``time_s``. Forces are means over the cycle that begins at
    the row, on the tool, about the tool tip, in axes of the part as it truly lies.

    Attributes:
        time_s: (n,) s, controller time.
        row: (n,) row of the tool path being run.
        motion: (n,) program motion being run.
        progress: (n,) share 0..1 of the commanded path's length that is done.
        kind: (n,) :data:`~counterflex.path.toolpath.RAPID` or ``FEED``.
        p_part_command: (n, 3) m, tool tip the controller interpolates, in its part frame.
        p_part_tcp: (n, 3) m, tool tip where it really is, in the frame of the part as it truly lies.
        tilt_part: (n, 3) rad, rotation vector from the commanded to the true tool frame, part axes.
        force_part: (n, 3) N.
        moment_part: (n, 3) N m.
        force_peak_n: (n,) N, largest mean-per-revolution force within the cycle.
        depth_m: (n,) largest axial depth engaged within the cycle, 0 in air.
        engaged: (n,) whether the tool removes material.
        q_ref: (n, 6) rad.
        q_motor: (n, 6) rad, what the encoders show.
        stock: The as-machined height map in the part frame.
        T_base_part: (4, 4) where the part truly lies.
        datum_residual_m: (k, 3) m, what the rigid fit to the touched datum points leaves, base axes; (0, 3) when the
            part frame was not touched.
    """

    time_s: Float
    row: Int
    motion: Int
    progress: Float
    kind: Int
    p_part_command: Float
    p_part_tcp: Float
    tilt_part: Float
    force_part: Float
    moment_part: Float
    force_peak_n: Float
    depth_m: Float
    engaged: Bool
    q_ref: Float
    q_motor: Float
    stock: HeightMap
    T_base_part: Float
    datum_residual_m: Float
