"""Build the robot catalogue from a folder of reference files.

Usage: ``python tools/build_catalog.py REFERENCE_FOLDER``, where the folder holds ``robots/*.json`` (geometry, limits,
check poses and the text that says how each was verified) and ``stiffness.csv``. Writes one TOML file per robot into
``src/counterflex/robot/model/catalog_data``. Only robots whose geometry is verified, or written alike in two files, are
taken, plus the KR 270-2, whose arm is the verified arm of its family and whose stiffness is published.

What the files do not say is added here in plain sight, with its source: the elastic bodies, bearing positions and
masses of the KR 300 R2500 ultra, and which stiffness set belongs to which robot.
"""

from __future__ import annotations

import csv
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from counterflex.core.arrays import Float
from counterflex.core.units import MM, URAD_PER_KNM
from counterflex.geometry import pose, rotation
from counterflex.robot.model import catalog
from counterflex.robot.model.description import Opw, Robot

TARGET = Path(__file__).resolve().parents[1] / "src" / "counterflex" / "robot" / "model" / "catalog_data"
BY_FAMILY = {"kuka_kr270_2"}
HAEHN = "Haehn2020 (Haehn, Weigold, Production Engineering 14, 2020), Table 1"
STIFFNESS_OF = {  # robot in the catalogue: (robot in stiffness.csv, method begins with)
    "kuka_kr270_2": ("KUKA KR 270-2 F (also used for KR 240/270)", "static loads"),
    "kuka_kr500_r2830": ("KUKA KR 500 / KR 500 MT", "clamped"),
}
ESTIMATED_AXES = {"kuka_kr500_r2830": (4, 5, 6)}
FLANGE_SECONDARY = {
    "kuka_kr500_r2830": "290 mm in two files, 250 mm in a third",
    "kuka_kr210_r2700_extra": "215 mm from the family, not measured",
}
GUESSED_MASSES = {"staubli_rx160", "staubli_rx160l"}  # by a remark in the first URDF, which the second copies
WORDS = [  # the reference files' own shorthand, turned into what a reader can follow
    (r"the same page reports", "the page with the DH table reports"),
    (r"\s*\(?stored file id \d+\)?( v1 KUKA KR500)?", ""),
    (r"as quoted in(?=;|$)", "as quoted in a public model file"),
    (r"paper 000 \(Denkena, KR 500\)", "Denkena2015"),
    (r"paper 001 \(Haehn & Weigold 2020\)", "Haehn2020"),
    (r"paper 003", "Mandiola2023"),
    (r"limits below come from", "limits come from"),
    (r" \(data/[a-z0-9_]+\)", ""),
    (r"laser-tracker data here", "laser-tracker data"),
    (r"laser-tracker fit made here", "laser-tracker fit"),
    (r"; same numbers remembered from [^;]*", ""),
    (r", its table not readable here", ", its table not seen"),
    (r"preset list,? \(", "preset list ("),
    (r"^preset list(?=;)", "preset list of a public model file"),
    (r"\(parameter list in Rust;\)", "(parameter list in Rust)"),
]

# KR 300 R2500 ultra: bearing centres along each axis from the foot of the previous offset, and the distribution of
# the mass over the bodies, a judgement of this project between published sets (total 1035 kg with the fixed base).
KR300_AXES = {
    1: {"bearing_mm": 350.0, "mass_kg": 320.0, "com_mm": [0.0, 0.0, 151.0]},
    2: {"bearing_mm": 0.0, "mass_kg": 115.0, "com_mm": [250.0, 0.0, 0.0]},
    3: {"bearing_mm": 0.0, "mass_kg": 150.0, "com_mm": [0.0, -76.0, 0.0]},
    4: {"bearing_mm": 420.0, "mass_kg": 60.0, "com_mm": [0.0, 0.0, 344.0]},
    5: {"bearing_mm": 0.0, "mass_kg": 36.0, "com_mm": [0.0, 60.0, 0.0]},
    6: {"bearing_mm": 130.0, "mass_kg": 14.0, "com_mm": [0.0, 0.0, 60.0]},
}
KR300_ELEMENTS: list[dict[str, Any]] = [
    # y along the link arm, z along axis 2: k_B is torsion about the long axis
    {"name": "link_arm", "after_axis": 2, "xyz_mm": [500.0, 0.0, 0.0], "abc_deg": [-90.0, 0.0, 0.0],
     "mass_kg": 85.0, "com_mm": [0.0, 200.0, 0.0]},
    # z along the forearm (axis 4), 0.20 m ahead of axis 3: k_A is torsion about the arm
    {"name": "arm", "after_axis": 3, "xyz_mm": [-41.0, 200.0, 0.0], "abc_deg": [0.0, 0.0, -90.0],
     "mass_kg": 40.0, "com_mm": [0.0, 0.0, 100.0]},
]  # fmt: skip
KR300_SOURCES = {
    "masses": {
        "status": "SECONDARY",
        "source": "judgement between published sets (Weigand, Robot_Identification @9e403c07; URDF of sister robots): "
        "total with base 1035 kg, single bodies +-30 %; centres of gravity guided by Weigand",
    },
    "bearings": {
        "status": "SECONDARY",
        "source": "judgement, none are published: axis 1 bearing 0.35 m above the floor, axis 4 bearing 0.42 m "
        "ahead of axis 3, axis 6 bearing 0.13 m ahead of the wrist centre",
    },
    "stiffness_about_axes": {"status": "VERIFIED", "source": f"{HAEHN}, k_A; cubes and laser triangulation"},
    "stiffness_tilt": {"status": "VERIFIED", "source": f"{HAEHN}, k_C (about x) and k_B (about y)"},
    "stiffness_links": {
        "status": "SECONDARY",
        "source": f"{HAEHN}, frames 3 and 5; values as published, place and axes of the frames ASSUMED: link arm at "
        "mid length with k_B about its long axis and k_A about axis 2, arm 0.20 m ahead of axis 3 with k_A about "
        "the forearm and k_B about axis 3",
        "effect": "with k_B and k_C of the arm exchanged, the deflections of the 60 published load cases change by 4 % "
        "in the mean and 8 % at most; of the link arm by 3 and 9 %",
    },
    "counterbalance": {
        "status": "SECONDARY",
        "source": "Weigand, Robot_Identification @9e403c07 (MIT): nitrogen cylinder, 162 bar at -90 deg, 200 bar at "
        "-40 deg as measured there",
    },
}


def main(reference: Path) -> None:
    """Write all files of the catalogue."""
    with (reference / "stiffness.csv").open(encoding="utf-8", newline="") as table:
        stiffness = list(csv.DictReader(table))
    TARGET.mkdir(parents=True, exist_ok=True)
    for old in TARGET.glob("*.toml"):
        old.unlink()
    for source in sorted((reference / "robots").glob("*.json")):
        raw = json.loads(source.read_text(encoding="utf-8"))
        if geometry_status(raw) is None:
            continue
        write(TARGET / f"{raw['id']}.toml", robot_file(raw, stiffness))
    write(TARGET / "end_effectors" / "haehn2020.toml", end_effector_file(stiffness))
    print(f"{len(list(TARGET.glob('*.toml')))} robots in {TARGET}")


def geometry_status(raw: dict[str, Any]) -> str | None:
    """``VERIFIED``, ``SECONDARY`` (two files that agree but for 0.5 mm, or by family), or None: not taken."""
    text = str(raw.get("verification", ""))
    if "opw" not in raw or "UNVERIFIED" in text:
        return None
    if "VERIFIED" in text:
        return "VERIFIED"
    return "SECONDARY" if "2 files" in text or raw["id"] in BY_FAMILY else None


def robot_file(raw: dict[str, Any], stiffness: list[dict[str, str]]) -> dict[str, Any]:
    """The catalogue file of one robot."""
    name, opw = raw["id"], raw["opw"]
    status = geometry_status(raw)
    sources: dict[str, Any] = {
        "geometry": {"status": status, "source": "; ".join([*raw["sources"], raw["verification"]])},
        "limits": {"status": "SECONDARY", "source": limits_source(raw)},
    }
    limits: dict[str, Any] = {
        "lower_deg": [float(low) for low, _ in raw["joint_limits_deg"]],
        "upper_deg": [float(high) for _, high in raw["joint_limits_deg"]],
    }
    if raw["joint_speed_limits_deg_s"]:
        limits["speed_deg_s"] = [float(v) for v in raw["joint_speed_limits_deg_s"]]
        sources["speeds"] = {"status": "SECONDARY", "source": limits_source(raw)}
    else:
        sources["speeds"] = not_known()
    if raw.get("joint_accel_limits_deg_s2"):
        limits["acceleration_deg_s2"] = [float(v) for v in raw["joint_accel_limits_deg_s2"]]
        place = "max_acceleration of its file of joint limits; for which posture and load is not said"
        sources["accelerations"] = {"status": "SECONDARY", "source": f"{limits_source(raw)}; {place}"}
    else:
        sources["accelerations"] = not_known()
    out: dict[str, Any] = {
        "format": "counterflex-robot",
        "version": 1,
        "name": name,
        "manufacturer": raw["manufacturer"],
        "model": raw["model"],
    }
    for key in ("payload_kg", "reach_mm"):
        if raw.get(key) is not None:
            out[key] = float(raw[key])
    out["notes"] = [*(raw.get("notes") or []), *raw["opw"].get("notes", [])]
    out["geometry"] = {f"{k}_mm": round(opw[f"{k}_m"] / MM, 6) for k in ("a1", "a2", "b", "c1", "c2", "c3", "c4")}
    out["geometry"] |= {"offsets_deg": opw["joint_offsets_deg"], "signs": opw["sign_corrections"]}
    out["limits"] = limits
    axes: dict[int, dict[str, Any]] = {axis: {"axis": axis} for axis in range(1, 7)}
    if name in FLANGE_SECONDARY:
        sources["geometry_flange"] = {"status": "SECONDARY", "source": f"c4: {FLANGE_SECONDARY[name]}"}
    for group in ("stiffness_about_axes", "stiffness_tilt", "stiffness_links", "masses", "bearings", "counterbalance"):
        sources[group] = not_known()
    sources["stiffness_translation"] = not_known()
    if name == "kuka_kr300_r2500_ultra":
        kr300(out, axes, sources, raw, stiffness)
    if name in STIFFNESS_OF:
        about_axes(name, axes, sources, stiffness)
    if raw.get("link_inertials"):
        inertials(raw, out, axes, sources)
    if any(len(row) > 1 for row in axes.values()):
        out["axes"] = list(axes.values())
    out["checks"] = [
        {
            "name": c["name"],
            "q_deg": [float(q) for q in c["q_deg"]],
            "position_mm": c["flange_position_mm"],
            "rotation": [[v + 0.0 for v in row] for row in c["flange_rotation_rowmajor"]],
        }
        for c in raw["fk_checks"]
    ]
    out["sources"] = sources
    return out


def limits_source(raw: dict[str, Any]) -> str:
    """Source of the limits: the note of the file where it has one, else its first source."""
    for note in raw.get("notes") or []:
        if "limits" in note and not note.startswith("TRAP"):
            return str(note)
    return str(raw["sources"][0])


def not_known() -> dict[str, str]:
    """Provenance of what nobody published."""
    return {"status": "not known", "source": ""}


def compliance(row: dict[str, str]) -> float:
    """1/k of a row of stiffness.csv in urad/(kN m); zero where it is rigid."""
    return 0.0 if row["value_Nm_per_rad"] == "rigid" else 1.0 / float(row["value_Nm_per_rad"]) / URAD_PER_KNM


def haehn_row(stiffness: list[dict[str, str]], element: str) -> list[float]:
    """Compliance about x, y, z (1/k_C, 1/k_B, 1/k_A) of an element of Haehn2020 Table 1."""
    rows = [
        r for r in stiffness if r["robot"] == "KUKA KR 300 R2500 ultra" and r["axis_or_element"].startswith(element)
    ]
    by = {r["component"][:3]: compliance(r) for r in rows}
    return [by["k_C"], by["k_B"], by["k_A"]]


def kr300(
    out: dict[str, Any],
    axes: dict[int, dict[str, Any]],
    sources: dict[str, Any],
    raw: dict[str, Any],
    stiffness: list[dict[str, str]],
) -> None:
    """The full table of Haehn2020, masses, bearings and counterbalance."""
    for axis, row in axes.items():
        row |= KR300_AXES[axis] | {"compliance_urad_per_knm": haehn_row(stiffness, f"A{axis} joint")}
    words = {"link_arm": "link arm", "arm": "arm ("}
    out["elements"] = [e | {"compliance_urad_per_knm": haehn_row(stiffness, words[e["name"]])} for e in KR300_ELEMENTS]
    c = raw["dynamics_sets"][0]["hydraulic_counterbalance"]
    out["counterbalance"] = {
        "axis": c["axis"],
        "anchor_column_mm": c["anchor_distance_link1_to_axis2_m"] / MM,
        "anchor_arm_mm": c["anchor_distance_link2_to_axis2_m"] / MM,
        "angle_of_least_force_deg": float(c["minimum_force_angle_deg"]),
        "piston_diameter_mm": c["piston_diameter_m"] / MM,
        "rod_diameter_mm": c["rod_diameter_m"] / MM,
        "gas_mass_kg": c["gas_mass_kg"],
        "gas_constant_j_per_kg_k": c["R_specific_J_per_kgK"],
        "gas_compressibility": c["compressibility_Z"],
        "gas_temperature_k": float(c["temperature_K"]),
        "gas_volume_max_m3": c["max_gas_volume_m3"],
    }
    sources |= KR300_SOURCES


def about_axes(
    name: str, axes: dict[int, dict[str, Any]], sources: dict[str, Any], stiffness: list[dict[str, str]]
) -> None:
    """Published stiffness about the joint axes of other robots."""
    robot, method = STIFFNESS_OF[name]
    rows = [
        r
        for r in stiffness
        if r["robot"] == robot and r["quantity"] == "torsional stiffness" and r["method"].startswith(method)
    ]
    for r in rows:
        axes[int(r["axis_or_element"][1])]["compliance_urad_per_knm"] = [0.0, 0.0, compliance(r)]
    estimated = ESTIMATED_AXES.get(name)
    note = f"; axes {', '.join(map(str, estimated))} are estimates (UNVERIFIED)" if estimated else ""
    sources["stiffness_about_axes"] = {
        "status": "SECONDARY",
        "source": f"{rows[0]['source']}; {rows[0]['method']}{note}",
    }


def inertials(
    raw: dict[str, Any], out: dict[str, Any], axes: dict[int, dict[str, Any]], sources: dict[str, Any]
) -> None:
    """Masses and centres of gravity of a URDF, carried from its link frames into the bearing frames at q = 0."""
    if not any(str(row["link"]).endswith("6") and row["mass_kg"] for row in raw["link_inertials"]):
        return
    robot = robot_of(out)
    T_link = np.eye(4)
    by_link = {str(row["link"])[-1]: row for row in raw["link_inertials"]}
    T_axis = np.eye(4)
    zero = np.linalg.multi_dot([np.eye(4), *(urdf_pose(joint) for joint in raw["urdf_chain"])])
    if not np.allclose(zero[:3, 3] / MM, raw["fk_checks"][0]["flange_position_mm"], atol=1e-3):
        raise SystemExit(f"{out['name']}: the URDF's zero pose is not the controller's")
    for axis in range(1, 7):
        joint = raw["urdf_chain"][axis - 1]
        T_link = T_link @ urdf_pose(joint)
        seg = robot.segments[axis - 1]
        T_axis = T_axis @ seg.T_prev_seg @ pose.make(rotation.about_z(seg.offset_rad))
        row = by_link[str(axis)]
        com = pose.transform(pose.inverse(T_axis) @ T_link, np.array(row["com_m"]))
        axes[axis] |= {"mass_kg": round(row["mass_kg"], 3), "com_mm": (com / MM).round(2).tolist()}
    guess = out["name"] in GUESSED_MASSES
    sources["masses"] = {
        "status": "UNVERIFIED" if guess else "SECONDARY",
        "source": f"link inertials of {raw['sources'][0]}" + ("; guesses by their own remark" if guess else ""),
    }


def urdf_pose(joint: dict[str, Any]) -> Float:
    """``<origin>`` of a URDF joint: fixed-axis roll, pitch, yaw."""
    roll, pitch, yaw = joint["rpy_rad"]
    return pose.from_xyz_zyx(np.array(joint["xyz_m"]), np.array([yaw, pitch, roll]))


def robot_of(out: dict[str, Any]) -> Robot:
    """The bare chain of a catalogue file under construction."""
    g = out["geometry"]
    lengths = {f"{k}_m": g[f"{k}_mm"] * MM for k in ("a1", "a2", "b", "c1", "c2", "c3", "c4")}
    opw = Opw(**lengths, offsets_rad=tuple(np.radians(g["offsets_deg"]).tolist()), signs=tuple(g["signs"]))
    limits = np.radians(np.stack([out["limits"]["lower_deg"], out["limits"]["upper_deg"]], axis=1))
    return catalog.from_opw(out["name"], opw, limits)


def end_effector_file(stiffness: list[dict[str, str]]) -> dict[str, Any]:
    """Sensor and spindle holder of Haehn2020."""
    return {
        "format": "counterflex-end-effector-elements",
        "version": 1,
        "elements": [
            {
                "name": "haehn2020_sensor",
                "after_axis": 0,
                "xyz_mm": [0.0, 0.0, 0.0],
                "abc_deg": [0.0, 0.0, 0.0],
                "compliance_urad_per_knm": haehn_row(stiffness, "force sensor"),
                "mass_kg": 11.0,
                "com_mm": [0.0, 0.0, 40.0],
            },
            {
                "name": "haehn2020_spindle_holder",
                "after_axis": 0,
                "xyz_mm": [0.0, 0.0, 80.0],
                "abc_deg": [0.0, 0.0, 0.0],
                "compliance_urad_per_knm": haehn_row(stiffness, "spindle and holder"),
                "mass_kg": 75.0,
                "com_mm": [70.0, 0.0, 110.0],
            },
        ],
        "sources": {
            "stiffness": {"status": "VERIFIED", "source": f"{HAEHN}, frames 9 (ATI Omega160) and 10"},
            "frame": {
                "status": "SECONDARY",
                "source": "ASSUMED, the paper does not say: flange axes, k_A about the flange axis z; sensor at the "
                "flange, holder 80 mm ahead of it; masses 11 and 75 kg and their centres of gravity are judgement",
            },
        },
    }


def worded(value: Any) -> Any:
    """The content with every text in words a reader of the catalogue can follow."""
    if isinstance(value, dict):
        return {key: worded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [worded(item) for item in value]
    if isinstance(value, str):
        for pattern, word in WORDS:
            value = re.sub(pattern, word, value)
    return value


def write(path: Path, content: dict[str, Any]) -> None:
    """Write a TOML file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tomli_w.dumps(worded(content)), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        raise SystemExit(__doc__)
    main(Path(sys.argv[1]))
