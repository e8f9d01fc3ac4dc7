"""What rsi make and egm make write, looked at as a controller would: by readers that share nothing with the writers.

The rules are those of published contexts and of the languages: one object per name, every wire ends at a port that
there is, the editor's files show what the controller reads, every set parameter is public, blocks of KRL and RAPID are
closed, every name is declared.
"""

from __future__ import annotations

import re
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from counterflex.app import examples
from counterflex.integrations.abb.link.setup import EgmMakeSettings as EgmSettings
from counterflex.integrations.kuka.link.setup import CheckSettings, RsiMakeSettings

PORTS = {  # type of object: its number, inputs, outputs
    "ETHERNET": (64, 64, 64),
    "POSCORR": (27, 6, 7),
    "POSCORRMON": (81, 0, 6),
    "AXISCORR": (33, 6, 7),
    "AXISCORRMON": (82, 0, 12),
    "STOP": (18, 1, 0),
    "MAP2SEN_PREA": (17, 1, 0),
    "SEN_PREA": (58, 0, 1),
    "MAP2OV_PRO": (25, 1, 0),
}
OLD_IDS = {"LowerLimX": 1, "UpperLimX": 4, "MaxRotAngle": 7, "LowerLimA6": 6, "UpperLimA1": 13, "Precision": 8}
NEW_IDS = {"LowerLimX": 0, "UpperLimX": 3, "MaxRotAngle": 6, "LowerLimA6": 5, "UpperLimA1": 6, "Precision": 7}
PROGRAM = """&ACCESS RVP
&REL 1
DEF part( )
; counterflex job 452f96504e90f0b6
WAIT SEC 0.0
CHANGE_TOOL( )
$TOOL=TOOL_DATA[1]
$BASE=BASE_DATA[1]
PTP XSTART
; M3 S9000
$OUT[17]=TRUE
$VEL.CP=0.25
LIN {X 0.0000,Y 0.0000,Z 5.0000,A 0.00000,B 90.00000,C 0.00000}
LIN {X 9.0000,Y 0.0000,Z 5.0000,A 0.00000,B 90.00000,C 0.00000} C_DIS
END
"""
DATA = "&ACCESS RVP\nDEFDAT part\nDECL E6AXIS XSTART={A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}\nENDDAT\n"
CELLS = {
    "RSI 3": 'rsi_version = "3.3"',
    "RSI 4": 'rsi_version = "4.1"',
    "RSI 5": 'rsi_version = "5.0"',
}


@pytest.fixture(params=[f"{rsi}, {way}" for rsi in CELLS for way in ("pose", "axes, override", "link test")])
def robot(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """A made set-up."""
    rsi, way = str(request.param).split(", ", 1)
    more = f"{CELLS[rsi]}\ncorrection_output = 31\n"
    text = examples.text("cell.toml").replace('rsi_version = "4.1"\n', more)
    assert more in text
    text += "\n[online]\ncorrection_mm = 1.5\n" + ('output = "axes"\n[override]\n' if "axes" in way else "")
    (tmp_path / "cell.toml").write_text(text, encoding="utf-8")
    (tmp_path / "part.src").write_text(PROGRAM, encoding="latin-1")
    (tmp_path / "part.dat").write_text(DATA, encoding="latin-1")
    program = None if way == "link test" else tmp_path / "part.src"
    RsiMakeSettings(tmp_path / "cell.toml", program).make(tmp_path / "robot")
    return tmp_path / "robot"


def test_what_is_made_has_no_finding(robot: Path) -> None:
    (main,) = robot.glob("*.src")
    (context,) = (path for path in robot.iterdir() if path.name in ("counterflex.rsi.xml", "counterflex.rsix"))
    judged = CheckSettings(robot / "counterflex_ethernet.xml", robot.parent / "cell.toml", context, main)
    assert [item.line() for item in judged.check()] == []


def local(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def objects(root: ElementTree.Element, first: int) -> dict[str, dict[str, Any]]:
    """Objects that a controller would make: type, number, wires (input to source and output, from 1), parameters."""
    found: dict[str, dict[str, Any]] = {}
    for item in root.iter():
        if local(item) not in ("RSIObject", "RsiObject"):
            continue
        given = {key.lower(): value for key, value in item.attrib.items()}
        assert given["objid"] not in found
        wires, parameters = {}, {}
        for part in item.iter():
            row = {key.lower(): value for key, value in part.attrib.items()}
            if local(part) == "Input":
                index = int(row["inidx"]) - first + 1
                assert index not in wires
                wires[index] = (row["outobjid"], int(row["outidx"]) - first + 1)
            elif local(part) == "Parameter":
                assert row["name"] not in parameters
                parameters[row["name"]] = row
        found[given["objid"]] = {
            "type": given["objtype"].upper(),
            "number": int(given["objtypeid"]),
            "wires": wires,
            "parameters": parameters,
        }
    return found


def context(robot: Path) -> dict[str, dict[str, Any]]:
    new = robot / "counterflex.rsix"
    if new.is_file():
        root = ElementTree.parse(new).getroot()
        assert (root.tag, root.attrib["SchemaVersion"]) == ("{RsiContext}RsiContext", "2.0.0")
        return objects(root, 0)
    root = ElementTree.parse(robot / "counterflex.rsi.xml").getroot()
    assert root.tag == "RSIObjects"
    return objects(root, 1)


def channels(robot: Path, section: str) -> dict[int, str]:
    """Declared channels of the ETHERNET file."""
    root = ElementTree.parse(robot / "counterflex_ethernet.xml").getroot()
    rows = [item.attrib for item in root.findall(f"{section}/ELEMENTS/ELEMENT")]
    found = {int(row["INDX"]): row["TAG"] for row in rows if row["INDX"] != "INTERNAL"}
    assert len(found) == sum(row["INDX"] != "INTERNAL" for row in rows)
    return found


def test_every_wire_ends_at_ports_that_there_are(robot: Path) -> None:
    made = context(robot)
    send, receive = channels(robot, "SEND"), channels(robot, "RECEIVE")
    assert sorted(receive) == list(range(1, len(receive) + 1))
    used = set()
    for item in made.values():
        number, inputs, outputs = PORTS[item["type"]]
        assert item["number"] == number
        for index, (source, output) in item["wires"].items():
            assert 1 <= index <= inputs
            assert 1 <= output <= PORTS[made[source]["type"]][2]
            if made[source]["type"] == "ETHERNET":
                assert output in receive
                used.add(output)
        if item["type"] not in ("ETHERNET", "POSCORR", "AXISCORR"):
            assert sorted(item["wires"]) == list(range(1, inputs + 1))  # these inputs must not stay open
        assert outputs >= 0
    assert used == set(receive)
    (ethernet,) = (item for item in made.values() if item["type"] == "ETHERNET")
    assert set(ethernet["wires"]) == set(send)
    assert ethernet["parameters"]["ConfigFile"]["paramvalue"] == "counterflex_ethernet.xml"
    written = [
        (item["type"], item["parameters"]["Index"]["paramvalue"])
        for item in made.values()
        if item["type"] in ("MAP2SEN_PREA", "SEN_PREA")
    ]
    indices = [index for _, index in written]
    assert len(set(indices)) == len(indices)  # nobody writes over another's variable
    assert all(1 <= int(index) <= 20 for index in indices)


def test_parameters_have_their_numbers_and_what_is_set_is_public(robot: Path) -> None:
    made = context(robot)
    old = (robot / "counterflex.rsi.xml").is_file()
    seen = 0
    for item in made.values():
        taken = set()
        for name, row in item["parameters"].items():
            if name in (OLD_IDS if old else NEW_IDS) and not (name == "MaxRotAngle" and "MON" in item["type"]):
                assert int(row["paramid"]) == (OLD_IDS if old else NEW_IDS)[name]
                seen += 1
            place = (row.get("isruntime", "true"), row["paramid"])
            assert place not in taken  # parameters that may change and those that may not are counted apart
            taken.add(place)
            if row["paramvalue"].replace(".", "").lstrip("-").isdigit():
                assert abs(float(row["paramvalue"])) <= 1e3
    assert seen >= 3
    source = next(robot.glob("*.src")).read_text(encoding="latin-1")
    calls = re.findall(r'RSI_SETPUBLICPAR\(cfid,"(\w+)","(\w+)",(-?[\d.]+)\)', source)
    assert len(calls) == source.count("RSI_SETPUBLICPAR") >= 7
    for name, parameter, value in calls:
        row = made[name]["parameters"][parameter]
        assert row["ispublic"] == "true"
        assert float(row["paramvalue"]) == pytest.approx(float(value), abs=1e-3)
    assert len(calls) == sum(row.get("ispublic") == "true" for i in made.values() for row in i["parameters"].values())
    created = re.search(r'RSI_CREATE\("([\w.]+)"', source)
    assert created is not None
    assert created[1] == ("counterflex.rsi" if old else "counterflex")


def test_the_editor_shows_what_the_controller_reads(robot: Path) -> None:
    made = context(robot)
    if (robot / "counterflex.rsix").is_file():
        root = ElementTree.parse(robot / "counterflex.rsix").getroot()
        assert [local(item) for item in root] == ["RsiObjects", "BlueprintCollections", "Constructs"]
        types = {item.attrib["Name"]: item for item in root.iter("{RsiBlueprint}Element")}
        drawn = {item.attrib["Name"]: item for item in root.iter("{RsiConstruct}Construct")}
        assert set(drawn) == set(made)
        for name, item in drawn.items():
            kind = types[item.attrib["BlueprintName"]]
            assert int(kind.attrib["Id"]) == made[name]["number"]
            wires = {(row.attrib["Name"], row.attrib["SourceObject"]) for row in item.iter("{RsiConstruct}Input")}
            assert len(wires) == len(made[name]["wires"])
            assert {source for _, source in wires} <= set(made)
            known = {row.attrib["Name"] for row in kind.iter() if local(row).endswith("Parameter")}
            assert set(made[name]["parameters"]) <= known
            open_ = {row.attrib["Name"] for row in item.iter() if row.attrib.get("CanBeSetFromKrl") == "true"}
            assert open_ == {n for n, row in made[name]["parameters"].items() if row.get("ispublic") == "true"}
        return
    model = ElementTree.parse(robot / "counterflex.rsi").getroot()
    shown = {item.attrib["name"]: item for item in model.iter() if local(item) == "rSIElement"}
    assert set(shown) == set(made)
    ports: dict[str, list[str]] = {}
    for name, item in shown.items():
        assert (item.attrib["objType"], int(item.attrib["objTypeID"])) == (made[name]["type"], made[name]["number"])
        ports[name] = [row.attrib["name"] for row in item.iter() if local(row) == "rSIOutPort"]
        rows = {row.attrib["name"]: row.attrib for row in item.iter() if local(row) == "rSIParameter"}
        assert set(rows) == set(made[name]["parameters"])
        for key, row in rows.items():
            there = made[name]["parameters"][key]
            assert row.get("isPublic") == there.get("ispublic")
            assert row.get("isRuntime") == there.get("isruntime")
            assert row["index"] == there["paramid"]
            word = {"Base": "1", "PathNormal": "1"}.get(row["value"], row["value"])
            assert word == there["paramvalue"]
    for name, item in shown.items():
        for index, port in enumerate((row for row in item.iter() if local(row) == "rSIInPort"), start=1):
            sources = [row.attrib["name"] for row in port.iter() if local(row) == "rSIOutPortMoniker"]
            wire = made[name]["wires"].get(index)
            assert sources == ([] if wire is None else [f"//{wire[0]}/{ports[wire[0]][wire[1] - 1]}"])
    diagram = ElementTree.parse(robot / "counterflex.rsi.diagram").getroot()
    ids = [item.attrib["Id"] for item in diagram.iter() if "Id" in item.attrib and "Moniker" not in local(item)]
    assert len({uuid.UUID(text) for text in ids}) == len(ids)
    ends = [item.attrib["Id"] for item in diagram.iter() if local(item).endswith("ShapeMoniker")]
    assert set(ends) <= set(ids)
    assert len(ends) == 2 * sum(len(item["wires"]) for item in made.values())
    named = [item.attrib["name"] for item in diagram.iter() if local(item) == "rSIElementMoniker"]
    assert sorted(named) == sorted(f"//{name}" for name in made)


BLOCKS = {"ENDIF": "IF", "ENDLOOP": "LOOP", "ENDWHILE": "WHILE", "ENDFOR": "FOR", "END": "DEF", "ENDFCT": "DEFFCT"}
KNOWN = set(
    re.findall(
        r"\w+",
        """DEF END DEFFCT ENDFCT DECL INT REAL BOOL IN IF THEN ENDIF LOOP ENDLOOP WHILE ENDWHILE FOR TO ENDFOR NOT AND
        OR TRUE FALSE RETURN HALT WAIT SEC BRAKE GLOBAL INTERRUPT ON OFF WHEN DO PTP LIN C_DIS ABS BAS IR_STOPM RSIOK
        RSI_CREATE RSI_SETPUBLICPAR RSI_ON RSI_OFF RSI_DELETE TOOL_DATA BASE_DATA CHANGE_TOOL X Y Z A B C
        ABSOLUTE IPO_FAST IPO INITMOV""",
    )
)


def krl_statements(text: str) -> Iterator[str]:
    """Statements of a KRL file without comments; texts in quotes emptied."""
    for line in text.splitlines():
        code = re.sub(r'"[^"]*"', '""', line).split(";")[0].strip()
        if code and not code.startswith("&"):
            yield code


def test_the_program_is_whole_krl(robot: Path) -> None:
    source = next(robot.glob("*.src")).read_text(encoding="latin-1")
    assert source.isascii()
    assert max(map(len, source.splitlines())) <= 160
    folds = re.findall(r"^;(FOLD|ENDFOLD)\s*\(?(.*?)\)?$", source, re.MULTILINE)
    open_: list[str] = []
    for word, name in folds:
        if word == "FOLD":
            open_.append(name)
        else:
            assert open_.pop() == name
    assert open_ == []
    stack: list[str] = []
    declared: set[str] = set()
    routines = {name.upper() for name in re.findall(r"^DEF(?:FCT\s+\w+)?\s+(\w+)\s*\(", source, re.MULTILINE)}
    begun = False
    for code in krl_statements(source):
        assert code.count("(") == code.count(")")
        assert code.count("{") == code.count("}")
        word = code.split()[0].split("(")[0].upper()
        if word in ("DEF", "DEFFCT"):
            assert stack == []
            stack.append(word)
            declared, begun = {"XSTART"}, False
            continue
        if word in BLOCKS:
            assert stack.pop() == BLOCKS[word]
            continue
        if word == "DECL":
            assert not begun  # declarations come before every instruction
            declared.add(code.split()[-1].upper())
            continue
        begun = True
        if word in ("IF", "LOOP", "WHILE", "FOR"):
            stack.append(word)
        for name in re.findall(r"(?<![\w$.#])[A-Za-z_]\w*", re.sub(r"\$[\w.]+|\bA[1-6]\b", "", code)):
            assert name.upper() in KNOWN | declared | routines, code
    assert stack == []
    if (robot / "part.dat").is_file():
        data = (robot / "part.dat").read_text(encoding="latin-1")
        assert re.search(r"^DECL E6AXIS XSTART=", data, re.MULTILINE)


def test_the_program_waits_and_never_goes_on_blindly(robot: Path) -> None:
    source = next(robot.glob("*.src")).read_text(encoding="latin-1")
    main = list(krl_statements(source))[: list(krl_statements(source)).index("END")]

    def at(piece: str) -> int:
        found = [i for i, code in enumerate(main) if piece in code]
        assert found, piece
        return found[0]

    assert at("INTERRUPT DECL 3") < at("BAS (#INITMOV") < at("$TOOL=") < at("RSI_CREATE") < at("HALT")
    assert at("$OUT[31]=FALSE") < at("RSI_CREATE")
    assert at("RSI_ON") < at("WHILE NOT (CF_ZERO") < at("RSI_OFF") < at("RSI_DELETE")
    zero = at("WHILE NOT (CF_ZERO")
    inside = main[zero : main.index("ENDWHILE", zero)]
    assert "HALT" in inside
    assert any(re.match(r"IF \$TIMER\[\d+\]>\d+ THEN", code) for code in inside)
    if "PTP XSTART" not in main:
        assert not any(code.startswith("$SEN_PREA[2]=") and "=0.0" not in code for code in main)
        return
    armed = at("WHILE NOT (($SEN_PREA[3]>1.5)")
    enabled = next(i for i, code in enumerate(main) if code.startswith("$SEN_PREA[2]=") and not code.endswith("=0.0"))
    assert at("RSI_ON") < armed < at("$OUT[31]=TRUE") < enabled < at("LIN {X 0.0000")
    assert "HALT" in main[armed : main.index("ENDWHILE", armed)]
    off = max(i for i, code in enumerate(main) if code == "$SEN_PREA[2]=0.0")
    assert at("LIN {X 9.0000") < off < zero < max(i for i, code in enumerate(main) if code == "$OUT[31]=FALSE")
    assert not any(re.match(r"WAIT SEC [1-9]", code) for code in main[off:])


RAPID_PATH = "".join(
    f"    MoveL [[{x}.0,0.0,34.0],[0.0,0.0,1.0,0.0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],v_p_1,{zone},t_p\\WObj:=w_p;\n"
    for x, zone in ((0, "fine"), (10, "z0"), (30, "z0"))
)
RAPID = (
    "MODULE p_m\n"
    "  PERS tooldata t_p:=[TRUE,[[0,0,100],[1,0,0,0]],[10,[0,0,50],[1,0,0,0],0,0,0]];\n"
    '  PERS wobjdata w_p:=[FALSE,TRUE,"",[[1000,0,500],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];\n'
    "  CONST speeddata v_p_1:=[25,100,5000,1000];\n"
    "  PROC p()\n    ConfL \\Off;\n"
    "    MoveAbsJ [[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]],[100,100,5000,1000],fine,t_p\\WObj:=w_p;\n"
    f"    SetDO doSpindle,1;\n{RAPID_PATH}    SetDO doSpindle,0;\n  ENDPROC\nENDMODULE\n"
)
RAPID_BLOCKS = {"ENDIF": "IF", "ENDWHILE": "WHILE", "ENDPROC": "PROC", "ENDMODULE": "MODULE"}
RAPID_WORDS = {  # instructions, functions and data that RobotWare brings
    *("CONFL", "MOVEABSJ", "MOVEL", "SETDO", "TPWRITE", "TPREADFK", "STOP", "EXIT", "RAISE", "WAITTIME", "WAITUNTIL"),
    *(
        "CLKRESET",
        "CLKSTART",
        "CLKREAD",
        "DISTANCE",
        "CPOS",
        "STEMPTY",
        "FINE",
        "Z0",
        "ERRNO",
        "ROB_1",
        "TRUE",
        "FALSE",
    ),
    *("ERR_UDPUC_COMM", "ERR_WAIT_MAXTIME", "ERR_TP_MAXTIME", "EGMRESET", "EGMGETID", "EGMSETUPUC", "EGMACTMOVE"),
    *("EGMSTREAMSTART", "EGMMOVEL", "EGMACTPOSE", "EGMRUNPOSE", "EGM_FRAME_WOBJ", "EGM_STOP_HOLD", "E9", "TFRAME"),
    *("DOSPINDLE", "DOCORRECTION", "DIARMED"),  # signals of the cell
}


@pytest.mark.parametrize("signal", ["", 'armed_signal = "diArmed"\n'])
@pytest.mark.parametrize("mode", ["path", "pose"])
def test_the_program_is_a_whole_rapid_module(tmp_path: Path, mode: str, signal: str) -> None:
    keys = f'correction_signal = "doCorrection"\n{signal}'
    text = examples.text("cell.toml").replace("[controller]\n", f"[controller]\n{keys}")
    text += f'\n[online]\nforce = "measured"\nperiod_ms = {24 if mode == "path" else 4}\n[egm]\nmode = "{mode}"\n'
    (tmp_path / "cell.toml").write_text(text, encoding="utf-8")
    (tmp_path / "p.mod").write_text(
        RAPID if mode == "path" else RAPID.replace("    SetDO doSpindle,0;\n", ""), encoding="latin-1"
    )
    EgmSettings(tmp_path / "cell.toml", tmp_path / "p.mod").make(tmp_path / "robot")
    module = (tmp_path / "robot/p.mod").read_text(encoding="latin-1")
    declared = {name.upper() for name in re.findall(r"^\s*(?:VAR|PERS|CONST)\s+\w+\s+(\w+)", module, re.MULTILINE)}
    stack: list[str] = []
    begun = False
    for raw in module.splitlines():
        code = re.sub(r'"[^"]*"', '""', raw).split("!")[0].strip()
        if not code:
            continue
        assert code.count("(") == code.count(")")
        assert code.count("[") == code.count("]")
        word = re.split(r"[\s;(]", code)[0].upper()
        if word in RAPID_BLOCKS:
            assert stack.pop() == RAPID_BLOCKS[word]
            continue
        if word in ("MODULE", "PROC", "IF", "WHILE"):
            stack.append(word)
            begun = begun or word == "PROC"
            assert word in ("MODULE", "PROC") or code.endswith((" THEN", " DO"))
        elif word == "ERROR":
            assert stack == ["MODULE", "PROC"]  # the handler stands at the end of the procedure
            continue
        elif word in ("VAR", "PERS", "CONST"):
            assert not begun
            assert code.endswith(";")
            continue
        else:
            assert code.endswith(";")
        if word in ("MODULE", "PROC"):
            continue
        for name in re.findall(r"(?<![\\\w])[A-Za-z_]\w*", code):
            known = RAPID_WORDS | declared | {"IF", "THEN", "WHILE", "DO", "AND", "OR"}
            assert name.upper() in known, code
    assert stack == []
    assert max(map(len, re.findall(r'"([^"]*)"', module))) <= 80  # a string of RAPID
    assert max(map(len, re.findall(r"\b[A-Za-z]\w*", module))) <= 32  # a name
    for setup in re.findall(r"EGMSetupUC.*", module):
        assert float(re.findall(r"CommTimeout:=([\d.]+)", setup)[0]) <= 0.1
    assert module.count("EGMGetId") == module.count("EGMSetupUC") == 1
    end = module.index("  ERROR")
    assert module.index("SetDO doCorrection,0") < module.index("MoveAbsJ") < module.index("SetDO doCorrection,1")
    assert module.index("SetDO doCorrection,1") < module.rindex("SetDO doCorrection,0", 0, end)
    assert module.rindex("EGMReset", 0, end) < module.rindex("MoveL", 0, end)
