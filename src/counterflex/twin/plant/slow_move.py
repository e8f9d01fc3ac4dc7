"""A slow motion of the simulated robot from where it stands to other joints and another load."""

from __future__ import annotations

import numpy as np

from counterflex.core.arrays import Float, as_float, as_positive
from counterflex.twin.plant.plant import Plant


def move(plant: Plant, q: Float, w_tcp_base: Float | None = None, *, move_s: float = 1.0, rest_s: float = 0.3) -> None:
    """Go from where the references stand to other joints and another load, slowly, and wait.

    Joints and load follow ``(1 - cos(pi t / T)) / 2`` together; drives, friction and play act as they do in any
    motion, so that what was done before shows in where the tool comes to rest.

    Args:
        q: (6,) rad, reference of the drives at the end.
        w_tcp_base: (6,) N, N m load at the end, on the tool about the tip in base axes; None is none.
        move_s: T, s.

    Raises:
        SimulationError: The robot becomes unstable.
    """
    q = as_float("q", q, (6,))
    load = np.zeros(6) if w_tcp_base is None else as_float("w_tcp_base", w_tcp_base, (6,))
    duration_s, wait_s = as_positive("move_s", move_s), as_positive("rest_s", rest_s, zero=True)
    count = max(1, round(duration_s / plant.step_s))
    t = (np.arange(count) / count)[:, None]
    share, rate = 0.5 * (1.0 - np.cos(np.pi * t)), 0.5 * np.pi * np.sin(np.pi * t) / (count * plant.step_s)
    q_from, load_from = plant.q_ref.copy(), plant.load.copy()
    place: Float = q_from + share * (q - q_from)
    speed: Float = rate * (q - q_from)
    wrench: Float = load_from + share * (load - load_from)
    for k in range(count):
        plant.step(place[k], speed[k], wrench[k])
    rest = np.zeros(6)
    for _ in range(round(wait_s / plant.step_s)):
        plant.step(q, rest, load)
    plant.check()
