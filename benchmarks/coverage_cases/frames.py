"""The tracker's frame from poses of an uncalibrated arm, and with fiducials, by a tracker that drifts and scales."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from counterflex.app.proof.truth import truth_of
from counterflex.core.arrays import Float
from counterflex.core.progress import silent
from counterflex.core.units import MM, MRAD, UM, URAD
from counterflex.geometry import pose, rotation
from counterflex.identify.data.changes import TableValues
from counterflex.identify.data.dataset import Dataset, of_arrays
from counterflex.identify.geometry.known_frames import KnownFrames, known_frames
from counterflex.identify.geometry.pose_residuals import COMPONENTS
from counterflex.identify.recipe import Identification
from counterflex.identify.tracker_frame import recipe as tracker_frame
from counterflex.identify.tracker_frame.proposal import propose
from counterflex.twin.laboratory import fiducials as measure_fiducials
from counterflex.twin.laboratory.laboratory import Laboratory, laboratory
from counterflex.twin.truth.truth import Truth
from coverage_cases.counted import Counted
from coverage_cases.poses import WALK_M, WALK_RAD, cell, cell_file, seen

POSES, FIDUCIALS = 24, 8
SCALE = 5e-6
"""Scale of the tracker's lengths (air, zero of its distances), one standard deviation."""
LINK_M, LINK_RAD = 0.2 * MM, 0.2 * MRAD
"""How far each link of an arm that was never calibrated is off, its foot included; one standard deviation per axis."""
COVERAGE = 1.96


@cache
def angles(count: int = POSES) -> Float:
    columns = propose(cell(), count, {"seed": 0}).columns
    out: Float = np.stack([columns[f"q{i + 1}_rad"] for i in range(6)], axis=1)
    return out


def scaled(data: Dataset, seed: int) -> Dataset:
    """Readings of a tracker whose lengths are not true."""
    name = "p_tracker_target" if data.has("p_tracker_target") else "p_tracker_fiducial"
    channel = data.channel(name)
    factor = 1.0 + SCALE * np.random.default_rng([41, seed]).standard_normal()
    return replace(data, channels={**data.channels, name: replace(channel, values=channel.values * factor)})


def drift(seed: int) -> Float:
    """(6,) m, rad: how the tracker wanders from the first round of fiducials to the second."""
    size = np.sqrt(FIDUCIALS) * np.repeat([WALK_M, WALK_RAD], 3)
    out: Float = size * np.random.default_rng([42, seed]).standard_normal(6)
    return out


def fiducials(truth: Truth, lab: Laboratory, *, errors: bool) -> Dataset:
    """Two rounds; with errors the tracker has wandered from one to the next."""
    moved = drift(lab.seed) * errors
    settings = {"rounds": 2, "drift_um": (moved[:3] / UM).tolist(), "drift_urad": (moved[3:] / URAD).tolist()}
    request = propose(cell(), FIDUCIALS, {"measure": "fiducials"}).columns
    m = measure_fiducials.measure(truth, lab, request, settings, silent)
    return of_arrays("fiducials", "fiducials", m.channels, m.sigma, group=m.group)


def uncalibrated(truth: Truth, *, errors: bool) -> Truth:
    """The arm with links that are off by more than the simulated cell's, in place and direction."""
    rng = np.random.default_rng([43, truth.seed or 0])
    off = errors * np.repeat([LINK_M, LINK_RAD], 3) * rng.standard_normal((len(truth.bodies), 6))
    bodies = [
        replace(body, T_prev_seg=body.T_prev_seg @ pose.make(rotation.exp(d[3:]), d[:3]))
        for body, d in zip(truth.bodies, off, strict=True)
    ]
    return replace(truth, bodies=tuple(bodies))


def tip_on_axis6(truth: Truth) -> Float:
    """(4, 4) tool tip in the frame that turns with axis 6, its zero included: what no pose tells from the target."""
    last = next(i for i, body in enumerate(truth.bodies) if body.joint == 5)
    T = pose.make(rotation.about_z(truth.bodies[last].offset_rad))
    for body in truth.bodies[last + 1 :]:
        T = T @ body.T_prev_seg
    out: Float = T @ truth.T_last_tcp
    return out


def frames_of(found: Identification) -> KnownFrames:
    """As the cell file then has them."""
    change = found.changes[0]
    assert isinstance(change, TableValues)
    known = known_frames(replace(cell(), tables={"tracker": change.values}))
    assert known is not None
    return known


def apart(name: str, T: Float, T_true: Float, sigma: Float) -> list[Counted]:
    """Six numbers: how far the true frame is from the found one, in its axes."""
    off = pose.inverse(T) @ T_true
    d = np.concatenate([off[:3, 3], rotation.log(off[:3, :3])])
    return [
        Counted(f"{name}.{c}", float(v), 0.0, float(s), -COVERAGE * float(s), COVERAGE * float(s))
        for c, v, s in zip(COMPONENTS, d, sigma, strict=True)
    ]


def frames_of_data(seed: int, data: Sequence[Dataset], truth: Truth, moved: Float | None = None) -> list[Counted]:
    """Tracker and target identified from some data; the tracker moved by (6,) m, rad since they began."""
    lab, none = laboratory(seed), truth_of(cell_file(), None)
    known = frames_of(tracker_frame.RECIPE.identify(cell(), data, [], {}, silent))
    assert known.sigma is not None
    assert known.target_sigma is not None
    T_base_tracker = lab.T_base_tracker
    if moved is not None:
        T_base_tracker = T_base_tracker @ pose.make(rotation.exp(moved[3:]), moved[:3])
    target = pose.inverse(tip_on_axis6(none)) @ tip_on_axis6(truth) @ lab.T_tcp_target
    return [
        *apart("T_base_tracker", known.T_base_tracker, T_base_tracker, known.sigma),
        *apart("T_tcp_target", known.T_tcp_target, target, known.target_sigma),
    ]


def frame_of_poses(seed: int, *, errors: bool) -> list[Counted]:
    """From poses alone."""
    truth, lab = uncalibrated(truth_of(cell_file(), seed), errors=errors), laboratory(seed)
    data = seen(truth, lab, angles(), errors=errors)
    return frames_of_data(seed, [scaled(data, seed) if errors else data], truth)


def frame_of_fiducials(seed: int, *, errors: bool) -> list[Counted]:
    """From fiducials and poses."""
    truth, lab = uncalibrated(truth_of(cell_file(), seed), errors=errors), laboratory(seed)
    data = [fiducials(truth, lab, errors=errors), seen(truth, lab, angles(), errors=errors)]
    return (
        frames_of_data(seed, [scaled(d, seed) for d in data], truth, drift(seed))
        if errors
        else frames_of_data(seed, data, truth)
    )
