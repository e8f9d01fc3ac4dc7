"""Modal groups of the codes and words of Sinumerik, and why others are refused: the table as the reader asks for it.

All statements and words of Sinumerik for milling, and what the reader does with each.

Source: SINUMERIK 840D sl / 828D, Programming Manuals Fundamentals, Job Planning and Cycles: lists of statements.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from counterflex.programs.gcode.read.code_table import Code, neutral, read, refused
from counterflex.programs.gcode.sinumerik.cycles import NAMES
from counterflex.programs.statement_table import Statement, StatementTable, Treatment

_CAM: Final = "Let the CAM system write the tool-centre path"
_MOTION_WORDS: Final = "Let the CAM system write the moves of the cycle"
_FRAMES: Final = "Post with TRANS, ATRANS, ROT, AROT, MIRROR, or without frames"
_VECTORS: Final = "Post A3= B3= C3="
_LINES: Final = "Post G0, G1, G2 and G3"
_RETRACT: Final = "Retract with a plain G0"
_CHANNEL: Final = "Take it out of the program"
_TRANSFORMATION: Final = "Use TRAORI or none"
_FEED: Final = "Write the feed as F"
_SYNCHRONOUS: Final = "Post the program without synchronized actions"

CODES: Final[tuple[Code, ...]] = (
    *read("G0 G1", "motion", "straight motion", "* X1 Y1 Z5 F600"),
    *read("G2 G3", "motion", "arc with I J K, CR= or AR=, helix with TURN=", "* X1 Y0 CR=1 F600"),
    *read("CIP", "motion", "arc through a point", "CIP X1 Y1 Z5 I1=0.3 J1=0.8 K1=5 F600"),
    *read("G4", "dwell", "dwell: F in seconds, S in revolutions", "G4 F0.5"),
    *read("G17 G18 G19", "plane", "plane of arcs, cycles and RPL"),
    *read("G70 G71 G700 G710", "unit", "unit of lengths, G700 and G710 of feeds too"),
    *read("G90 G91", "distance", "values count from zero, or from where the tool stands"),
    *read("G93 G94 G95", "feed", "meaning of F"),
    *read("G40", "cutter radius", "no cutter radius compensation"),
    *read("G54 G55 G56 G57", "work offset", "settable offset; the first one is that of the part"),
    *read("G500", "work offset", "no settable offset: the place in the part is not known"),
    *read("G53 G153 SUPA", "machine", "motion without offsets, to a place that is not known", "* G0 Z0"),
    *read("TRANS ATRANS", "frame", "shift of the zero", "* X1"),
    *read("ROT AROT", "frame", "rotation about one axis", "* Z30"),
    *read("MIRROR AMIRROR", "frame", "mirror image of the axes named", "* X0"),
    *read("TRAORI TRAFOOF", "transformation", "X Y Z are the tool tip; direction A3 B3 C3 or A B C"),
    *neutral("G60|G64|G641|G642|G643|G644|G645", "exact stop, blending: how the control follows the path",
             group="path control"),
    *neutral("G601|G602|G603", "when an exact stop is reached", group="exact stop"),
    *neutral("G9", "exact stop for one block", group="exact stop once"),
    *neutral("G450|G451", "corners under cutter radius compensation", group="corner"),
    *neutral("G460|G461|G462", "approach under cutter radius compensation", group="approach"),
    *neutral("G290", "Siemens mode"),
    *refused("G41 G42 G41.1 G42.1", "cutter radius compensation * depends on the control's tool table", _CAM, "* D1"),
    *refused("G33 G34 G35 G63 G331 G332", "threads and tapping are not milling of a path", _MOTION_WORDS, "* Z-5 K1"),
    *read("G74 G75", "machine", "to a fixed point of the machine, which is not known", "* Z1=0"),
    *refused("G751", "a fixed point of the machine is not known here", _RETRACT, "G751 X0"),
    *refused("G58 G59", "axial offsets G58 and G59 are not read", "Use TRANS and ATRANS", "* X1"),
    *refused("G110 G111 G112 AP RP", "polar coordinates are not read", "Post X, Y and Z", "*=1"),
    *refused("G96 G961 G962 G97 G971 G972 G973", "constant cutting speed is turning, not milling", "Use S in rpm"),
    *refused("G931 G942 G952", "this meaning of F is not read", _FEED),
    *refused("G140 G141 G142 G143 G147 G148 G247 G248 G340 G341 G347 G348", "soft approach * is not read", _LINES),
    *refused("G291", "the ISO dialect is not read here", "Give it as G-code (--dialect linuxcnc)"),
    *refused("G62 G621", "a lower feed at corners is a setting of the control", "Use G60 or G64"),
    *refused("CT", "the tangential arc CT is not read", "Post G2 or G3 with I J K or CR=", "CT X1 Y1"),
    *refused("ASPLINE BSPLINE CSPLINE POLY OEMIPO1 OEMIPO2 INVCW INVCCW", "splines are not read", "Post G1"),
    *refused("RND RNDM CHF CHR ANG", "chamfers and roundings are not read", _CAM, "*=1"),
    *refused("SCALE ASCALE", "a scale of the path is not read", "Post the program at its size", "* X2"),
    *refused("ROTS AROTS CROTS CRPL TOFRAME TOFRAMEX TOFRAMEY TOFRAMEZ TOROT TOROTX TOROTY TOROTZ PAROT MEAFRAME",
             "this frame is not read", _FRAMES),
    *refused("CYCLE800", "a swivelled plane, or a retraction to a place of the machine, is not read", _FRAMES,
             "CYCLE800(1,\"TABLE\",0,57,0,0,0,0,30,0,0,0,0,1)"),
    *refused("TRANSMIT TRACYL TRAANG TRACON TCARR TCOABS TCOFR", "this transformation is not read", _TRANSFORMATION),
    *refused("ORICONCW ORICONCCW ORICONIO ORICONTO ORICURVE ORIROTA ORIROTR ORIROTT ORIROTC",
             "this way of giving the tool axis is not read", _VECTORS),
    *refused("A2 B2 C2 LEAD TILT A4 B4 C4 A5 B5 C5 A6 B6 C6 A7 B7 C7 XH YH ZH THETA PSI NUT",
             "this way of giving the tool axis is not read", _VECTORS, "*=1"),
    *refused("FL VELOLIM", "* limits the speed of an axis, and with it the feed", _FEED, "*[X]=50"),
    *refused("SETMS", "S and M3 belong to another spindle", "Use the first spindle", "SETMS(2)"),
    *refused("FB FZ FD FA OVR OVRA OVRRAP FGREF FXS FXST FXSW FOC",
             "* changes the feed or stops short", _FEED, "*=50"),
    *refused("SPCON COUPON CP GANTRY LEADON TRAILON MASLON EGON TANG TANGON", "coupled axes are not read", _CHANNEL),
    *refused("ID IDS WHEN WHENEVER EVERY DO FROM", "synchronized actions are not read", _SYNCHRONOUS,
             "* =1 DO $A_OUT[1]=1"),
    *refused("REPOSL REPOSQ REPOSH REPOSA RMI RMB RME SETINT INTERRUPT", "interrupts are not read", _CHANNEL),
    *refused("MEAS MEAW MEASA MEAWA MEAC", "measuring has no known end point",
             "Take probing out of the program", "*=1"),
    *refused("POS POSA POSP OSCILL OS", "positioning and oscillating axes are not read", _LINES, "*[X]=1"),
    *refused("GOTOS", "a jump to the start runs the program for ever", "End it with M30"),
    *refused("REDEF DEFINE", "a declaration that is not read", "Use DEF", "* REAL A"),
    *refused("CYCLE60 CYCLE61 CYCLE62 CYCLE63 CYCLE64 CYCLE70 CYCLE71 CYCLE72 CYCLE73 CYCLE74 CYCLE75 CYCLE76 CYCLE77 "
             "CYCLE78 CYCLE79 CYCLE84 CYCLE840 CYCLE85 CYCLE86 CYCLE87 CYCLE88 CYCLE89 CYCLE90 CYCLE801 CYCLE802 "
             "CYCLE899 CYCLE98 CYCLE99 CYCLE976 CYCLE977 CYCLE978 CYCLE979 CYCLE995 CYCLE996 HOLES1 HOLES2 SLOT1 SLOT2 "
             "POCKET1 POCKET2 POCKET3 POCKET4 LONGHOLE", "machining cycles are not read", _MOTION_WORDS, "*(1)"),
)  # fmt: skip

FURTHER_OFFSETS: Final = tuple(f"G{number}" for number in range(505, 600))
"""Settable offsets beyond G57."""
_SETTINGS: Final[tuple[tuple[str, str, str], ...]] = (
    ("BRISK SOFT DRIVE BRISKA SOFTA DRIVEA FFWON FFWOF DYNNORM DYNPOS DYNROUGH DYNSEMIFIN DYNFINISH DYNPREC",
     "how the control accelerates", ""),
    ("CFC CFTCP CFIN", "feed at arcs under cutter radius compensation", ""),
    ("COMPOF COMPON COMPCURV COMPCAD COMPSURF COMPPATH", "how the control smooths the path", ""),
    ("CYCLE832", "tolerance of smoothing", "CYCLE832(0.01,1,1)"),
    ("CYCLE800()", "ends a swivelled plane, or swivels by nothing; none is active", ""),
    ("STOPRE FIFOCTRL STARTFIFO STOPFIFO", "how far the control reads ahead", ""),
    ("MSG", "message", 'MSG("text")'),
    ("ORIWKS ORIMKS ORIVECT ORIPLANE ORIAXES ORIVIRT1 ORIVIRT2 ORISOF ORISON ORIRESET OSOF OSC OSS OSSE OSD",
     "how directions go between blocks: linear here", ""),
    ("UPATH SPATH", "parameter of the path of other axes", ""),
    ("WORKPIECE GROUP_BEGIN GROUP_END G_END", "picture and outline of the program", 'WORKPIECE(,"",,"BOX",0,0,-9,-80)'),
    ("DISPLOF DISPLON ACTBLOCNO SBLOF SBLON SAVE", "what the control shows", ""),
    ("FNORM FLIN FCUB FPO", "how the feed goes to its new value", ""),
    ("DIAMOF", "radii are radii", ""),
    ("SETMS()", "S and M3 belong to the first spindle", "SETMS(1)"),
    ("KONT NORM KONTC KONTT", "approach under cutter radius compensation", ""),
    ("CDOF CDOF2 CDON WALIMOF WALIMON", "watch over collisions and working area", ""),
    ("RTLION RTLIOF", "how rapids are interpolated", ""),
    ("WAITM WAITMC WAITE WAITS INIT START SETM CLEARM GETD GET RELEASE", "waits for channels and axes", ""),
    ("M0 M1", "stops until a person starts again", ""),
    ("M7 M8 M9", "coolant", ""),
    ("M40 M41 M42 M43 M44 M45", "gear of the spindle", ""),
)  # fmt: skip
_VALUES: Final[tuple[tuple[str, str, str], ...]] = (
    ("ADIS ADISPOS OTOL CTOL STOLF", "tolerance of blending", "*=0.05"),
    ("ACC ACCLIM JERKLIM", "limits of an axis", "*[X]=50"),
    ("DISC", "corners under cutter radius compensation", "*=50"),
    ("LIMS", "limit of the spindle speed", "*=8000"),
    ("D H", "number of a tool offset: the control compensates it", "*1"),
    ("N", "block number", "N10"),
)
_FLOW: Final[tuple[tuple[str, str], ...]] = (
    ("IF", "IF R1==1"), ("ELSE", "ELSE"), ("ENDIF", "ENDIF"), ("FOR", "FOR R1=1 TO 3"), ("ENDFOR", "ENDFOR"),
    ("WHILE", "WHILE R1<3"), ("ENDWHILE", "ENDWHILE"), ("LOOP", "LOOP"), ("ENDLOOP", "ENDLOOP"), ("REPEAT", "REPEAT"),
    ("UNTIL", "UNTIL R1==3"), ("GOTO", "GOTO A"), ("GOTOF", "GOTOF A"), ("GOTOB", "GOTOB A"), ("GOTOC", "GOTOC A"),
    ("CASE", "CASE(R1) OF 1 GOTOF A DEFAULT GOTOF B"), ("REPEATB", "REPEATB A P=2"), ("REPEAT LABEL", "REPEAT A P=2"),
    ("LABEL:", "A:"),
)  # fmt: skip
_EVALUATED: Final[tuple[tuple[str, str, str], ...]] = (
    ("DEF", "declares variables", "DEF REAL A=1"),
    ("PROC", "parameters of a subprogram", "PROC SUB(REAL A)"),
    ("EXTERN", "names a subprogram and its parameters", "EXTERN SUB(REAL)"),
    ("R=", "R parameter, with arithmetic", "R1=2*3"),
    ("NAME=", "variable of the program", "A=2"),
    (
        "$SC_FRAME_OFFSET_INCR_PROG=",
        "whether G91 travels a change of the zero (SD42440)",
        "$SC_FRAME_OFFSET_INCR_PROG=1",
    ),
    ("NAME( )", "calls a subprogram of the file or folder", "SUB(1)"),
    ("L", "calls a subprogram", "L10 P2"),
    ("CALL", "calls a subprogram by name", 'CALL "SUB"'),
    ("PCALL", "calls a subprogram by path", "PCALL SUB"),
    ("EXTCALL", "calls a subprogram of the folder", 'EXTCALL "SUB"'),
    ("MCALL", "calls a drilling cycle or subprogram behind each motion", "MCALL CYCLE81(5,0,2,-3)"),
    ("CYCLE81", "drilling", "CYCLE81(5,0,2,-3)"),
    ("CYCLE82", "drilling with a dwell", "CYCLE82(5,0,2,-3,,0.1)"),
    ("CYCLE83", "deep drilling", "CYCLE83(5,0,2,-6,,-2,,0,0,0,1,0)"),
    ("M2", "end of the program", "M2"),
    ("M30", "end of the program", "M30"),
    ("M17", "end of a subprogram", "M17"),
    ("RET", "end of a subprogram", "RET"),
    ("M3", "spindle", "M3"),
    ("M4", "spindle", "M4"),
    ("M5", "spindle", "M5"),
    ("M6", "the tool that T chose", "T1 M6"),
    ("M19", "orients the spindle, which stops", "M19"),
    ("SPOS", "orients the spindle, which stops", "SPOS=0"),
    ("SPOSA", "orients the spindle, which stops", "SPOSA=0"),
    ("F", "feed", "F600"),
    ("S", "spindle speed", "S1000"),
    ("T", "tool of the next M6, by number or name", "T1"),
    *((axis, "target", f"G1 {axis}=1 F600") for axis in ("X", "Y", "Z", "A", "B", "C")),
    ("A3 B3 C3", "direction of the tool", "A3=0 B3=0 C3=1"),
    ("AC( ) IC( )", "a value from zero, or from where the tool stands", "G1 X=AC(1) F600"),
    ("CR= AR= TURN=", "radius, angle and turns of an arc", "G2 X1 Y0 CR=1 F600"),
)
_OTHER_REFUSED: Final[tuple[tuple[str, str, str, str], ...]] = (
    ("FGROUP", "which axes F belongs to", "Leave X, Y and Z in the group", "FGROUP(X,Y)"),
    ("$P_UIFR= $P_PFRAME=", "data of the control are set", _FRAMES, "$P_UIFR[1]=CTRANS(X,1)"),
    ("$TC_DP=", "data of the control are set", "Set tools on the control", "$TC_DP3[1,1]=100"),
)


def _split(rows: tuple[tuple[str, str, str], ...], treatment: Treatment) -> list[Statement]:
    return [
        Statement(word, treatment, reason, samples=(sample.replace("*", word) or word,))
        for words, reason, sample in rows
        for word in words.split()
    ]


TABLE: Final = StatementTable(
    "sinumerik",
    "SINUMERIK 840D sl, Programming Manuals Fundamentals, Job Planning and Cycles",
    (
        *(code.statement for code in CODES),
        Statement("G505 to G599", Treatment.EVALUATED, "settable offset", samples=("G505",)),
        *_split(_SETTINGS, Treatment.NEUTRAL),
        *_split(_VALUES, Treatment.NEUTRAL),
        *(Statement(word, Treatment.EVALUATED, "flow of the program", samples=(sample,)) for word, sample in _FLOW),
        *(Statement(word, Treatment.EVALUATED, reason, samples=(sample,)) for word, reason, sample in _EVALUATED),
        *(Statement(word, Treatment.REFUSED, why, fix, (sample,)) for word, why, fix, sample in _OTHER_REFUSED),
    ),
)
CARRIED: Final = frozenset(
    word for words, _, _ in _SETTINGS for word in words.split() if not (word[0] == "M" and word[1:].isdecimal())
)
"""Words without a value that change no target."""
CARRIED_VALUES: Final = frozenset(
    word for words, _, _ in _VALUES for word in words.split() if word not in ("D", "H", "N")
)
"""Words with a value that change no target."""


@dataclass(frozen=True)
class WordTable:
    """Words of a dialect that is read as Sinumerik is."""

    dialect: str  # Its name, for errors
    group: Mapping[str, str]  # Modal group of each code or word that is read
    carried: frozenset[str]  # Words that change no target
    carried_values: frozenset[str]  # The same with a value
    refused: Mapping[str, tuple[str, str]]  # Words that are known and not taken, with the reason and what to do
    m_codes: frozenset[int]  # M codes that are read
    cycles: tuple[str, ...]  # Beginnings of the names of machining cycles
    drilling: tuple[str, ...] = ()  # Names of cycles that are read
    subprograms: bool = False  # Other names call subprograms


GROUP: Final = {code.word: code.group for code in CODES if code.group} | dict.fromkeys(FURTHER_OFFSETS, "work offset")
"""Modal group of each code or word that is read."""
REFUSED: Final = {code.word: (code.reason, code.remedy) for code in CODES if code.treatment is Treatment.REFUSED}
"""Words that the reader knows and does not take, with the reason and what to do."""
_MOVES: Final = "Let the CAM system write the moves of the cycle"
_UNROLLED: Final = "Post the program without subprograms, jumps and calculations"
REFUSED_CYCLE: Final = ("machining cycles are not read", _MOVES)
REFUSED_CALL: Final = ("a subprogram is called, and subprograms are not read", _UNROLLED)
AXES: Final = "XYZ"
ROTARY: Final = "ABC"
VECTOR: Final = ("A3", "B3", "C3")
M_CODES: Final = frozenset((0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 17, 19, 30, *range(40, 46)))
M_END: Final = frozenset((2, 17, 30))
SINUMERIK: Final = WordTable(
    "Sinumerik", GROUP, CARRIED, CARRIED_VALUES, REFUSED, M_CODES,
    ("CYCLE", "HOLES", "SLOT", "POCKET", "LONGHOLE", "ORI"), NAMES, subprograms=True,
)  # fmt: skip
