"""What changes slowly in a true cell while it works: a growing spindle, a drifting arm, tools, and the pull of a hose.

They are brought up to date every :data:`EVERY_S` of simulated time only.
"""

from __future__ import annotations

import math
from typing import Final

import mujoco
import numpy as np

from counterflex.core.arrays import Float
from counterflex.geometry import pose
from counterflex.geometry.wrench import cross
from counterflex.twin.plant.hose import Hose
from counterflex.twin.truth.other import HosePack
from counterflex.twin.truth.truth import Truth

EVERY_S: Final = 4.0e-3
_FIRST = 1  # the engine's body 0 is the world


def hose_of(pack: HosePack) -> Hose:
    """The hose of a truth."""
    return Hose(
        p_arm_clamp=np.array(pack.p_arm_clamp),
        p_tool_clamp=np.array(pack.p_tool_clamp),
        tool_exit=np.array([1.0, 0.0, 0.0]),
        mass_kg=pack.mass_kg,
        slack_m=pack.slack_m,
        pull_n_m=pack.pull_n_m,
        bending_nm=pack.bending_nm,
    )


class SlowChanges:
    """Writes growth and drift into the engine's model and keeps the generalised forces of the hose.

    Args:
        truth: With other kinds.
        model: Of the engine; its tool tip and base body are moved.
        data: Its state.
        site: Number of the tool tip.
        body_id: Number of each body by name.

    Attributes:
        hose_force: (n,) generalised forces of the hose at the last update.
        tool_growth_m: How much longer the tool in use is than the one that touched the part.
    """

    def __init__(
        self, truth: Truth, model: mujoco.MjModel, data: mujoco.MjData, site: int, body_id: dict[str, int]
    ) -> None:
        self._truth, self._model, self._data, self._site = truth, model, data, site
        self._tip: Float = model.site_pos[site].copy()
        self._along: Float = np.array(truth.T_last_tcp[:3, 2])
        self._base: Float = model.body_pos[_FIRST].copy()
        self.hose_force: Float = np.zeros(model.nv)
        self.tool_growth_m = 0.0
        pack = truth.other.hose
        self._hose = None if pack is None else hose_of(pack)
        if pack is not None:
            self._arm, self._tool = body_id[pack.arm_body], body_id[truth.bodies[-1].name]

    def update(self, since_touch_s: float) -> None:
        """Bring all to a time since the part was touched; positions count from the next kinematics on."""
        heat = self._truth.other.thermal
        grown, drift = self.tool_growth_m, 0.0
        if heat is not None:
            grown += heat.spindle_m * -math.expm1(-since_touch_s / heat.spindle_s)
            drift = -math.expm1(-since_touch_s / heat.arm_s)
            self._model.body_pos[_FIRST] = self._base + drift * np.array(heat.arm_m)
        self._model.site_pos[self._site] = self._tip + grown * self._along
        self.pull()

    def pull(self) -> None:
        """Forces of the hose at the engine's present kinematics: pull, bending, half its weight on each clamp."""
        if self._hose is None:
            return
        d, g = self._data, self._truth.gravity_base
        T_arm, T_tool = (pose.make(d.xmat[i].reshape(3, 3), d.xpos[i]) for i in (self._arm, self._tool))
        place, w = self._hose.on_tool(T_arm, T_tool, g)
        weight = 0.5 * self._hose.mass_kg * g
        far = pose.transform(T_arm, self._hose.p_arm_clamp)
        reaction = 2.0 * weight - w[:3]
        moment = -w[3:] - cross(place - far, w[:3] - weight)
        self.hose_force[:] = 0.0
        for body, at, force, turn in ((self._tool, place, w[:3], w[3:]), (self._arm, far, reaction, moment)):
            mujoco.mj_applyFT(self._model, d, force, turn, at, body, self.hose_force)
