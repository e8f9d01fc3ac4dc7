"""Benchmark of the elastic step against the peers that are installed, and of deflections in batches.

``python benchmarks/elastic_step.py [--quick] [--json FILE]``. The chain is the KR 300 R2500 ultra with sensor and
holder of Haehn2020: ten stations, thirty rotational compliances. A step is: rigid and elastic pose, Cartesian
compliance, deflection, two Newton steps with residual. Calls alternate in blocks. Times include the call from Python.
The peers compute the same step: Pinocchio with springs as real joints and NumPy around it, JAX as one fused graph.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

from counterflex.core.arrays import Float, Int
from counterflex.core.jit import kernel
from counterflex.robot.elasticity.chain import ElasticChain
from counterflex.robot.elasticity.kernels.batch import ON_RIGID, compliance_threads, deflection_threads
from counterflex.robot.elasticity.kernels.lanes import deflection_lanes
from counterflex.robot.model import catalog, load_cases
from online_step import ElasticStep

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "references"))
import elastic_equations as equations  # the specification that the tests judge by

Step = Callable[[Float, Float], tuple[Float, Float]]  # q, w -> deflection, q_c


def available(name: str) -> bool:
    """Return whether a library is installed."""
    return importlib.util.find_spec(name) is not None


def pinocchio_step(chain: ElasticChain) -> Step:
    """Full step with Pinocchio's compiled kinematics: springs are real joints, C = J K^-1 J^T, Newton in NumPy."""
    import pinocchio as pin

    model = pin.Model()
    parent, placement = 0, pin.SE3.Identity()
    drives, springs, soft = [], [], []
    kinds = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ, pin.JointModelRZ, pin.JointModelRY, pin.JointModelRX)
    for i in range(chain.n):
        placement = placement * pin.SE3(chain.fixed[i])
        if chain.joint[i] >= 0:
            parent = model.addJoint(parent, pin.JointModelRZ(), placement, f"drive{i}")
            placement = pin.SE3.Identity()
            drives.append(model.idx_vs[parent])
        for kind, d in zip(kinds, (0, 1, 2, 5, 4, 3), strict=True):
            if chain.compliance[i, d] > 0.0:
                parent = model.addJoint(parent, kind(), placement, f"{i}.{d}")
                placement = pin.SE3.Identity()
                springs.append(model.idx_vs[parent])
                soft.append(chain.compliance[i, d])
    tip = placement * pin.SE3(chain.T_last_tcp)
    model.addFrame(pin.Frame("tcp", parent, tip, pin.FrameType.OP_FRAME))
    data, frame = model.createData(), model.getFrameId("tcp")
    driven = np.flatnonzero(chain.joint >= 0)
    sign, offset = chain.sign[driven], chain.offset[driven]
    c = np.array(soft)
    x = pin.neutral(model)
    local = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

    def rigid(q: Float) -> Any:
        x[:] = 0.0
        x[drives] = sign * q + offset
        return pin.computeFrameJacobian(model, data, x, frame, local)

    def bent(w: Float, J: Any) -> Any:
        x[springs] = c * (J[:, springs].T @ w)
        pin.framesForwardKinematics(model, data, x)
        return data.oMf[frame]

    def step(q: Float, w: Float) -> tuple[Float, Float]:
        J = rigid(q)
        T0 = data.oMf[frame].copy()
        Js = J[:, springs]
        _compliance = (Js * c) @ Js.T
        Jq = J[:, drives] * sign
        A = Jq @ Jq.T
        T = bent(w, J)
        d = error = np.concatenate([T.translation - T0.translation, pin.log3(T.rotation @ T0.rotation.T)])
        q_c = q
        for _ in range(2):
            q_c = q_c - Jq.T @ np.linalg.solve(A, error)
            T = bent(w, rigid(q_c))
            error = np.concatenate([T.translation - T0.translation, pin.log3(T.rotation @ T0.rotation.T)])
        return d, q_c

    return step


def jax_step(chain: ElasticChain) -> Step:
    """Full step with JAX in double precision on the CPU."""
    import jax
    import jax.numpy as jnp

    jax.config.update("jax_enable_x64", True)
    soft, fixed, tip = jnp.array(chain.compliance), jnp.array(chain.fixed), jnp.array(chain.T_last_tcp)

    def about(axis: int, angle: Any) -> Any:
        co, si, one, nil = jnp.cos(angle), jnp.sin(angle), jnp.ones_like(angle), jnp.zeros_like(angle)
        rows = {
            0: [[one, nil, nil], [nil, co, -si], [nil, si, co]],
            1: [[co, nil, si], [nil, one, nil], [-si, nil, co]],
            2: [[co, -si, nil], [si, co, nil], [nil, nil, one]],
        }[axis]
        return jnp.stack([jnp.stack(row) for row in rows])

    def walk(q: Any, delta: Any) -> tuple[Any, Any]:
        R, p = jnp.eye(3), jnp.zeros(3)
        Rs, ps = [], []
        for i in range(chain.n):
            p = p + R @ fixed[i, :3, 3]
            R = R @ fixed[i, :3, :3]
            if chain.joint[i] >= 0:
                R = R @ about(2, chain.sign[i] * q[int(chain.joint[i])] + chain.offset[i])
            Rs.append(R)
            ps.append(p)
            if delta is not None and np.any(chain.compliance[i] > 0.0):
                if np.any(chain.compliance[i, :3] > 0.0):
                    p = p + R @ delta[i, :3]
                R = R @ about(2, delta[i, 5]) @ about(1, delta[i, 4]) @ about(0, delta[i, 3])
        return jnp.stack([*Rs, R @ tip[:3, :3]]), jnp.stack([*ps, p + R @ tip[:3, 3]])

    def bent(q: Any, w: Any) -> tuple[Any, Any, Any, Any]:
        Rs, ps = walk(q, None)
        moment = w[3:] + jnp.cross(ps[-1] - ps[:-1], w[:3])
        local = jnp.concatenate([jnp.einsum("nij,i->nj", Rs[:-1], w[:3]), jnp.einsum("nij,ni->nj", Rs[:-1], moment)], 1)
        Re, pe = walk(q, soft * local)
        return Rs, ps, Re[-1], pe[-1]

    def difference(R0: Any, p0: Any, R1: Any, p1: Any) -> Any:
        R = R1 @ R0.T
        v = 0.5 * jnp.stack([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        s2 = v @ v
        return jnp.concatenate([p1 - p0, v * (1.0 + s2 / 6.0 + 3.0 * s2 * s2 / 40.0)])

    driven = np.flatnonzero(chain.joint >= 0)

    def step(q: Any, w: Any) -> tuple[Any, Any, Any]:
        Rs, ps, Re, pe = bent(q, w)
        R0, p0 = Rs[-1], ps[-1]
        lever = p0 - ps[:-1]
        bend = jnp.cross(jnp.swapaxes(Rs[:-1], 1, 2), lever[:, None, :])
        columns = jnp.concatenate(
            [
                jnp.concatenate([jnp.swapaxes(Rs[:-1], 1, 2), jnp.zeros((chain.n, 3, 3))], 2),
                jnp.concatenate([bend, jnp.swapaxes(Rs[:-1], 1, 2)], 2),
            ],
            1,
        )
        C = jnp.einsum("ndi,nd,ndj->ij", columns, soft, columns)
        axis = chain.sign[driven, None] * Rs[driven, :, 2]
        J = jnp.concatenate([jnp.cross(axis, lever[driven]), axis], 1).T
        d = error = difference(R0, p0, Re, pe)
        q_c = q
        for _ in range(2):
            q_c = q_c - J.T @ jnp.linalg.solve(J @ J.T, error)
            _, _, Re, pe = bent(q_c, w)
            error = difference(R0, p0, Re, pe)
        return d, q_c, C

    one = jax.jit(step)

    def single(q: Float, w: Float) -> tuple[Float, Float]:
        d, q_c, _ = one(q, w)
        return np.asarray(d), np.asarray(q_c)

    return single


def flops(chain: ElasticChain) -> dict[str, int]:
    """Floating-point operations per point, zeros of this chain skipped; sine, cosine, root count 10."""
    stations = chain.compact.stations
    place = 6 * int(np.count_nonzero(stations["position"]))
    turn: Int = stations["turn"]
    turns = int(np.array([0, 18, 18, 18, 45])[turn].sum())
    driven = int(np.sum(stations["drive"] >= 0))
    bends, slides = (int(np.count_nonzero(stations[name])) for name in ("rotates", "slides"))
    rigid = place + turns + 18 * driven
    # moment 15, into element axes 18, six polynomials 60, three plane rotations 54; slide: force 18, move 18
    elastic = place + turns + 18 * driven + bends * (15 + 18 + 60 + 54) + slides * 36
    difference = 27 + 6 + 20
    trig = 12 * 10
    compliance = bends * (9 + 30 + 27 + 18 + 24) + slides * 54
    return {
        "deflection": trig + rigid + elastic + difference,
        "compliance": trig + rigid + compliance,
    }


@kernel()
def multiply_add(values: Float, a: float, b: float, rounds: int) -> None:
    """16 dependent multiply-adds on each of many values: the compiler's peak rate."""
    for _ in range(rounds):
        for i in range(len(values)):
            x = values[i]
            x = (((x * a + b) * a + b) * a + b) * a + b
            x = (((x * a + b) * a + b) * a + b) * a + b
            x = (((x * a + b) * a + b) * a + b) * a + b
            x = (((x * a + b) * a + b) * a + b) * a + b
            values[i] = x


def peak_flops() -> float:
    """Multiply-adds per second of one core, counted twice, from compiled code on 8 KiB."""
    values = np.ones(1024)
    multiply_add(values, 0.999, 1e-3, 2)
    best = 0.0
    for _ in range(9):
        start = time.perf_counter()
        multiply_add(values, 0.999, 1e-3, 200)
        best = max(best, 2.0 * 16 * 1024 * 200 / (time.perf_counter() - start))
    return best


def single_calls(
    candidates: dict[str, Callable[[Float, Float], Any]], q: Float, w: Float, blocks: int, calls: int
) -> dict[str, Any]:
    """Percentiles in us of each candidate, blocks of calls alternating between them."""
    clock = time.perf_counter_ns
    times: dict[str, list[int]] = {name: [] for name in candidates}
    for block in range(blocks):
        for name, call in candidates.items():
            slow = name not in ("counterflex", "counterflex, inputs in place", "empty call")
            for k in range(max(4, calls // 20) if slow else calls):
                i = (block * calls + k) % len(q)
                start = clock()
                call(q[i], w[i])
                times[name].append(clock() - start)
    return {
        name: {"p50_us": float(np.percentile(t, 50)) / 1e3, "p99_us": float(np.percentile(t, 99)) / 1e3,
               "p999_us": float(np.percentile(t, 99.9)) / 1e3, "calls": len(t)}
        for name, t in times.items()
    }  # fmt: skip


def batches(candidates: dict[str, tuple[int, Callable[[], Any]]], rounds: int) -> dict[str, dict[str, float]]:
    """Median and least us per point of each candidate (points, call), rounds alternating."""
    times: dict[str, list[float]] = {name: [] for name in candidates}
    for _ in range(rounds):
        for name, (n, call) in candidates.items():
            start = time.perf_counter()
            call()
            times[name].append((time.perf_counter() - start) / n * 1e6)
    return {name: {"median": float(np.median(t)), "least": min(t)} for name, t in times.items()}


def ratio(peers: dict[str, float], own: float) -> float | None:
    """Time of the best peer over ours, or None without peers."""
    return min(peers.values()) / own if peers else None


def run(quick: bool) -> dict[str, Any]:
    """Measure everything; ``quick`` only shows that it runs."""
    chain = ElasticChain.build(catalog.load("kuka_kr300_r2500_ultra"), load_cases.end_effector())
    rng = np.random.default_rng(0)
    n = 4096 if quick else 65536
    q = rng.uniform([-1.5, -2.0, 1.2, -2.5, 0.5, -3.0], [1.5, -1.2, 2.2, 2.5, 1.6, 3.0], (n, 6))
    w = rng.uniform(-1.0, 1.0, (n, 6)) * [800.0, 800.0, 800.0, 20.0, 20.0, 20.0]
    step = ElasticStep(chain)

    def in_place(_q: Float, _w: Float) -> int:
        return step.run()

    candidates: dict[str, Callable[[Float, Float], Any]] = {
        "counterflex": step,
        "counterflex, inputs in place": in_place,
        "empty call": lambda _q, _w: None,
        "equations in NumPy": lambda a, b: equations.step(chain, a, b, equations.DOUBLE),
    }
    checks: dict[str, float] = {}

    def check(name: str, d: Float, q_c: Float) -> None:
        step(q[0], w[0])
        checks[name] = float(max(np.max(np.abs(d[:3] - step.d[:3])) * 1e3, np.max(np.abs(q_c - step.q_c)) * 1e3))

    if available("pinocchio"):
        pin = pinocchio_step(chain)
        candidates["Pinocchio"] = pin
        check("Pinocchio", *pin(q[0], w[0]))
    if available("jax"):
        one = jax_step(chain)
        candidates["JAX"] = one
        check("JAX", *one(q[0], w[0]))
    for call in candidates.values():
        call(q[0], w[0])
    single = single_calls(candidates, q, w, 4 if quick else 40, 200 if quick else 2000)

    c = chain.compact
    out, C = np.empty((n, 6)), np.empty((n, 36))
    ours: dict[str, Callable[[], Any]] = {
        "deflection, lanes": lambda: deflection_lanes(c, q, w, out),
        "deflection, scalar": lambda: deflection_threads(c, q, w, ON_RIGID, 0, out),
        "compliance, scalar": lambda: compliance_threads(c, q, C),
    }
    for call_batch in ours.values():
        call_batch()
    batch: dict[str, dict[str, float]] = {}
    most = numba.config.NUMBA_NUM_THREADS
    for threads in (1, 2):
        if threads > most:
            continue
        numba.set_num_threads(threads)
        label = f"{threads} thread" + ("s" if threads > 1 else "")
        these = {f"{name}, {label}": (n, call_batch) for name, call_batch in ours.items()}
        batch |= batches(these, 3 if quick else 15)
    numba.set_num_threads(most)

    peak = peak_flops()
    counted = flops(chain)
    share = {
        name: counted[name.split(",")[0]] / (row["least"] * 1e-6) / peak
        for name, row in batch.items()
        if name.endswith("1 thread")
    }
    peers = {name: row["p50_us"] for name, row in single.items() if name in ("Pinocchio", "JAX")}
    return {
        "schema": "counterflex-benchmark-elastic-step",
        "version": 1,
        "quick": quick,
        "machine": {"processor": platform.processor() or platform.machine(), "python": platform.python_version(),
                    "numba": numba.__version__, "numpy": np.__version__},
        "stations": len(c.stations) - 1,  # without the tool tip
        "points": n,
        "single": single,
        "batch_us_per_point": batch,
        "flops_per_point": counted,
        "peak_gflops_one_core": peak / 1e9,
        "share_of_peak": share,
        "difference_to_peers_mm_mrad": checks,
        "speedup_single_over_best_peer": ratio(peers, single["counterflex"]["p50_us"]),
    }  # fmt: skip


def show(result: dict[str, Any]) -> None:
    """Print the tables."""
    print(f"single call, us{'p50':>33} {'p99':>9} {'p99.9':>9} {'calls':>8}")
    for name, row in result["single"].items():
        print(f"  {name:<36} {row['p50_us']:9.2f} {row['p99_us']:9.2f} {row['p999_us']:9.2f} {row['calls']:8d}")
    head = f"batch of {result['points']}, us/point"
    print(f"{head:<38} {'median':>9} {'least':>9} {'points/s':>9} {'of peak':>8}")
    for name, row in result["batch_us_per_point"].items():
        share = result["share_of_peak"].get(name)
        percent = "" if share is None else f"{100 * share:6.1f} %"
        print(f"  {name:<36} {row['median']:9.3f} {row['least']:9.3f} {1e6 / row['median']:9.3g} {percent:>8}")
    print(f"peak of one core {result['peak_gflops_one_core']:.1f} GFlop/s; flops per point {result['flops_per_point']}")
    if result["speedup_single_over_best_peer"] is not None:
        print(
            f"faster than the best installed peer: single call {result['speedup_single_over_best_peer']:.1f} x; "
            f"largest difference of results (mm, mrad) {result['difference_to_peers_mm_mrad']}"
        )


def main() -> None:
    """Parse the command line, measure, print, and write JSON where asked."""
    parser = argparse.ArgumentParser(description="Benchmark of the elastic step")
    parser.add_argument("--quick", action="store_true", help="a smoke run of a few seconds")
    parser.add_argument("--json", type=Path, help="write the figures to this file")
    arguments = parser.parse_args()
    result = run(arguments.quick)
    show(result)
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
