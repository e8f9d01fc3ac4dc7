"""Program and data files of VAL3 and a cell to read them in, for tests."""

from __future__ import annotations

import numpy as np

from counterflex.geometry import pose, rotation
from counterflex.integrations.staubli.language.read.motions import Val3Cell
from counterflex.programs.robot_writer.machine_functions import MachineFunctions

DOWN = 'ry="180" fatherId="fPart[0]"'
SPEEDS = ('tmax="50" blend="off"', 'tmax="25.5" blend="cartesian" leave="1" reach="1"', 'blend="off"')


def program(*lines: str) -> str:
    """A program file."""
    code = "".join(f"  {line}\n" for line in lines)
    head = '<Programs>\n  <Program name="part">\n<Code><![CDATA[\nbegin\n'
    return f"{head}{code}end\n]]></Code>\n  </Program>\n</Programs>\n"


def data(points: list[str], speeds: tuple[str, ...] = SPEEDS) -> str:
    """A data file with a frame, a tool, speeds and points."""
    out = "<Database>\n  <Datas>\n"
    for name, kind, values in (
        ("fPart", "frame", ['x="100" rz="90" fatherId="world[0]"']),
        ("tMill", "tool", ['z="100" fatherId="flange[0]"']),
        ("mRun", "mdesc", list(speeds)), ("jRest", "jointRx", ['j1="5"']), ("p", "pointRx", points),
    ):  # fmt: skip
        rows = "".join(f'      <Value key="{key}" {value} />\n' for key, value in enumerate(values))
        out += f'    <Data name="{name}" access="private" xsi:type="array" type="{kind}" size="{len(values)}">\n{rows}'
        out += "    </Data>\n"
    return out + "  </Datas>\n</Database>\n"


def at(x: float, y: float, z: float, more: str = DOWN) -> str:
    """Attributes of a point."""
    return f'x="{x}" y="{y}" z="{z}" {more}'


def cell(**changes: object) -> Val3Cell:
    """A cell with one tool and statements for the spindle."""
    table = MachineFunctions("val3", {
        3: ["aioSpeed={s}", "dioSpindle=true"], 5: ["dioSpindle=false"], 6: ["call change({t})"],
    })  # fmt: skip
    about: dict[str, object] = {
        "where": "cell.toml", "tools": [4], "T_flange_tcp": pose.make(np.eye(3), np.array([0.0, 0.0, 0.1])),
        "T_base_part": pose.make(rotation.about_z(0.5 * np.pi), np.array([0.1, 0.0, 0.0])), "functions": table,
        "tool_of_data": {},
    }  # fmt: skip
    return Val3Cell(**(about | changes))  # type: ignore[arg-type]
