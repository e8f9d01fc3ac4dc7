"""All G and M codes and statements of G-code for milling, and what the reader does with each.

LinuxCNC's documents are the reference where controls differ; codes that only Fanuc or Haas have are those of their
manuals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from counterflex.programs.statement_table import Statement, StatementTable, Treatment

_EVALUATED, _NEUTRAL, _REFUSED = Treatment.EVALUATED, Treatment.NEUTRAL, Treatment.REFUSED


@dataclass(frozen=True)
class Code:
    """A G or M code."""

    word: str  # As written; with a letter behind it (``G5.1 Q``) where that word makes it another code
    treatment: Treatment  # What the reader does with it
    group: str  # Modal group; two codes of one group in a block are refused. Empty for a refused one.
    reason: str  # See :class:`~counterflex.programs.statement_table.Statement`
    remedy: str = ""  # There too
    sample: str = ""  # A complete block
    takes: str = ""  # Letters of the words that belong to a neutral code

    @property
    def statement(self) -> Statement:
        """Row of the table of statements."""
        return Statement(self.word, self.treatment, self.reason, self.remedy, (self.sample,))


def read(words: str, group: str, reason: str, sample: str = "") -> list[Code]:
    """Return rows of codes that are evaluated; ``*`` in the sample stands for the code."""
    return [
        Code(word, Treatment.EVALUATED, group, reason, sample=sample.replace("*", word) or word)
        for word in words.split()
    ]


def neutral(words: str, reason: str, sample: str = "", takes: str = "", group: str = "") -> list[Code]:
    """Return rows of neutral codes, divided by ``|``; each is a group of its own where none is named."""
    return [
        Code(w, Treatment.NEUTRAL, group or w, reason, sample=sample.replace("*", w) or w, takes=takes)
        for w in words.split("|")
    ]


def refused(words: str, reason: str, remedy: str, sample: str = "") -> list[Code]:
    """Return rows of refused codes; ``*`` in reason and sample stands for the code."""
    return [
        Code(word, Treatment.REFUSED, "", reason.replace("*", word), remedy, sample.replace("*", word) or word)
        for word in words.split()
    ]


_CAM: Final = "Let the CAM system write the tool-centre path"
_CYCLE: Final = "Use G81, G82, G83, G85, G86 or G89, or let the CAM system write the moves"
_MOVES: Final = "Let the CAM system write the moves"
_PLAIN: Final = "Post the path in three axes, or with G43.4 and a [machine] table in the cell file"
_PROBE: Final = "Take probing out of the program"
_NOT_MILLING: Final = "Take it out of the program"
_MODES: Final = "Set the modes with their own codes"

G_CODES: Final[tuple[Code, ...]] = (
    *read("G0 G1", "motion", "straight motion", "* X1 Y1 Z5 F600"),
    *read("G2 G3", "motion", "arc and helix with I J K or R", "* X1 Y0 I0.5 F600"),
    *read("G4", "non-modal", "dwell: P, or X where there is no P, in seconds", "G4 P0.5"),
    *refused("G5", "splines G5 are not read", _CAM, "G5 X1 Y1 I0.1 J0.1 P1 Q1"),
    *neutral("G5 P", "high-speed machining mode: how the control follows the path", "G5 P10000", "P"),
    *refused("G5.1", "splines G5.1 are not read", _CAM, "G5.1 X1 Y1 I0.1 J0.1"),
    *neutral("G5.1 Q", "AI contour control, smoothing: how the control follows the path", "G5.1 Q1", "QPRXYZABC"),
    *refused("G5.2 G5.3 G6.2", "splines * are not read", _CAM, "* X1 Y1 P1"),
    *refused("G7", "lathe diameter mode G7 is not milling", "Use radii"),
    *refused("G7.1", "cylindrical interpolation G7.1 is not read", _MOVES, "G7.1 C20"),
    *neutral("G8", "radius mode; with P look-ahead: how the control follows the path", takes="P", group="diameter"),
    *neutral("G9", "exact stop for one block: how the control follows the path"),
    *read("G10", "non-modal", "L2, L20: zero of a work offset", "G10 L2 P1 X0 Y0 Z0"),
    *neutral("G11", "ends the setting of data"),
    *refused("G12 G13", "pocket cycle * of one control is not read", _MOVES, "* I5 D1 F600"),
    *refused("G12.1 G13.1 G112 G113", "polar interpolation * is not read", _MOVES),
    *read("G15 G16", "polar", "polar coordinates off and on: radius and angle in the plane"),
    *read("G17 G18 G19", "plane", "plane of arcs, cycles and rotation"),
    *refused("G17.1", "the UV plane G17.1 is not read", "Use G17, G18 or G19"),
    *refused("G18.1", "the WU plane G18.1 is not read", "Use G17, G18 or G19"),
    *refused("G19.1", "the VW plane G19.1 is not read", "Use G17, G18 or G19"),
    *read("G20 G21", "units", "unit of lengths and feeds"),
    *neutral("G22|G23", "stored stroke check: may stop the machine, moves nothing", takes="XYZIJK"),
    *neutral("G25|G26", "watch over the spindle speed", takes="PQRI"),
    *refused("G27", "the check of a reference point G27 moves the machine to it", _NOT_MILLING, "G27 X0 Y0"),
    *read("G28 G30", "non-modal", "through a point to a stored position", "G91 * Z0"),
    *read("G28.1 G30.1", "non-modal", "stores the position for G28 or G30"),
    *refused("G29", "the return from a reference point G29 depends on the way to it", _MOVES, "G29 X0 Y0"),
    *refused("G31", "the skip function G31 has no known end point", _PROBE, "G31 Z-5 F100"),
    *refused("G33", "spindle-synchronised motion G33 is not milling", _CYCLE, "G33 Z-5 K1"),
    *refused("G33.1", "rigid tapping G33.1 is not milling", _CYCLE, "G33.1 Z-5 K1"),
    *refused("G35 G36 G37 G37.1 G136", "measuring * has no known end point", _PROBE, "* Z-5"),
    *refused("G38.2 G38.3 G38.4 G38.5 G38.6 G38.8", "probing * has no known end point", _PROBE, "* Z-5 F100"),
    *read("G40", "cutter radius", "no cutter radius compensation"),
    *refused("G41 G42", "cutter radius compensation * depends on the machine's tool table", _CAM, "* D1"),
    *refused("G41.1 G42.1 G41.2 G42.2 G141", "cutter radius compensation * is not read", _CAM, "* D8"),
    *read("G43", "tool length", "tool length offset H, which the control compensates", "G43 H1"),
    *read("G43.1", "tool length", "tool length offset by words", "G43.1 Z0"),
    *refused("G43.2", "additional tool offsets G43.2 are not read", "Use G43 or G43.1", "G43.2 H1"),
    *read("G43.4 G43.5", "tool length", "X Y Z are the tool tip in the part; direction A B C or I J K"),
    *refused("G44", "a negative tool length offset G44 depends on the machine's tool table", "Use G43", "G44 H1"),
    *refused("G45 G46 G47 G48", "tool offsets * depend on the machine's tool table", _CAM, "* X1 D1"),
    *read("G49", "tool length", "no tool length offset"),
    *read("G50", "scaling", "no scaling"),
    *read("G50.1 G51.1", "mirror", "mirror image off and on about X, Y or Z", "* X0"),
    *refused(
        "G51", "scaling G51: the unit of its factor (1, 0.001 or 0.00001) is a parameter of the control",
        "Post the program at its size", "G51 X0 Y0 Z0 P2",
    ),
    *read("G52", "non-modal", "shift of program zero", "G52 X0 Y0 Z0"),
    *read("G53", "non-modal", "motion in machine coordinates", "G53 G0 Z0"),
    *refused("G53.1 G53.6", "a tilted working plane * moves the rotary axes of its machine", _PLAIN),
    *read("G54 G55 G56 G57 G58 G59 G59.1 G59.2 G59.3", "work offset", "work offset"),
    *read("G54.1 G154", "work offset", "further work offset P", "* P1"),
    *refused("G60", "G60 approaches from one direction: by how much it overshoots is a parameter", "Use G0", "G60 X1"),
    *neutral("G61|G61.1", "exact stops: how the control follows the path", group="path control"),
    *neutral("G62", "lower feed in inner corners under cutter radius compensation", group="path control"),
    *refused("G63", "tapping mode G63 is not milling", _CYCLE),
    *neutral("G64", "blending: how the control follows the path", "G64 P0.01", "PQ", group="path control"),
    *read("G65", "non-modal", "calls a macro with arguments", "G65 P9010 A1"),
    *refused("G66 G66.1", "the modal call of a macro * is not read", "Call it with G65 at each place", "* P9010 A1"),
    *neutral("G67", "ends a modal call of a macro"),
    *read("G68", "rotation", "rotation in the plane about a point", "G68 X0 Y0 R30"),
    *refused("G68.1 G68.2 G68.3 G68.4", "a tilted working plane * moves the rotary axes of its machine", _PLAIN,
              "* X0 Y0 Z0 I0 J30 K0"),
    *read("G69", "rotation", "no rotation"),
    *refused("G69.1 G254 G255 G234 G268 G269 G143", "* belongs to the rotary axes of its machine", _PLAIN),
    *refused("G76", "threading cycle G76 is not milling", _CYCLE, "G76 P1 Z-1"),
    *refused("G70 G71", "* is a turning cycle, a hole pattern or the unit, by control", "Write G20 or G21 for the unit",
             "* Z-1 R2"),
    *refused("G72 G77 G87 G88 G13.3 G150 G47.1", "cycle * is not read", _CYCLE, "* Z-1 R2"),
    *read("G73 G83", "motion", "drilling cycle with pecks", "* X1 Y1 Z-1 R2 Q0.5 F100"),
    *read("G81 G85", "motion", "drilling cycle", "* X1 Y1 Z-1 R2 F100"),
    *read("G82 G86 G89", "motion", "drilling cycle with a dwell", "M3 S1000 * X1 Y1 Z-1 R2 P0.1 F100"),
    *refused("G74 G84 G84.2 G84.3 G174 G184", "tapping * is not milling", _CYCLE, "* Z-1 R2"),
    *read("G80", "motion", "no motion code"),
    *read("G90 G91", "distance", "values count from zero, or from where the tool stands"),
    *read("G90.1 G91.1", "arc distance", "centres of arcs count from zero, or from the start"),
    *read("G92", "non-modal", "program zero from where the tool stands", "G92 X0 Y0 Z0"),
    *read("G92.1 G92.2 G92.3", "non-modal", "clears, suspends and restores G92"),
    *read("G93 G94 G95", "feed", "meaning of F"),
    *read("G96", "spindle mode", "constant cutting speed", "G96 S100 D5000"),
    *read("G97", "spindle mode", "S in 1/min"),
    *read("G98 G99", "retract", "height at the end of a cycle"),
    *refused("G100 G101", "the mirror image * of one control is not read", "Use G51.1, or post it mirrored", "* X0"),
    *neutral("G103", "how many blocks the control reads ahead", "G103 P1", "P"),
    *refused("G107", "cylindrical mapping G107 is not read", _MOVES),
    *neutral("G187", "smoothness: how the control follows the path", "G187 P1", "PE"),
)  # fmt: skip

M_CODES: Final[tuple[Code, ...]] = (
    *neutral("M0|M1|M60", "stops until a person starts again", group="stopping"),
    *read("M2 M30", "stopping", "end of the program"),
    *read("M3 M4 M5", "spindle", "spindle on and off"),
    *read("M6", "tool change", "the tool that T chose", "T1 M6"),
    *neutral("M7|M8|M9", "coolant", group="coolant"),
    *neutral("M88|M89|M83|M84", "coolant through the spindle, air"),
    *neutral("M10|M11|M12|M13", "clamps of rotary axes", group="clamps"),
    *read("M19", "spindle", "orients the spindle, which stops"),
    *neutral("M31|M33|M34|M35", "chips, nozzles"),
    *neutral("M41|M42", "gear of the spindle", group="gear"),
    *neutral("M48|M49|M50|M51|M52|M53", "whether the operator's override acts", group="override"),
    *read("M61", "tool change", "the tool in the spindle", "M61 Q1"),
    *neutral("M62|M63|M64|M65", "outputs", "* P1", group="output"),
    *read("M66", "input", "waits for an input; #5399 is not known from then on", "M66 P1 L0"),
    *neutral("M67|M68", "outputs", "* E1 Q1", group="output"),
    *refused("M70 M71 M72 M73", "* saves or restores a modal state and is not read", _MODES),
    *refused("M29 M135", "* prepares rigid tapping, which is not milling", _CYCLE, "* S500"),
    *refused("M96", "M96 jumps by an input signal", "Post the program without jumps", "M96 P10 Q1"),
    *read("M97", "stopping", "subprogram of the same file, by block number", "M97 P100"),
    *read("M98", "stopping", "subprogram of the same file or folder", "M98 P100"),
    *read("M99", "stopping", "end of a subprogram"),
    *refused("M109", "a person enters a value (M109)", "Write the value itself", "M109 P501"),
)  # fmt: skip

_O: Final = "o1 "
STATEMENTS: Final[tuple[Statement, ...]] = (
    *(Statement(f"O... {word}", _EVALUATED, "subroutine", samples=(sample,)) for word, sample in (
        ("sub", "o1 sub"), ("endsub", "o1 endsub"), ("call", "o1 call [1]"), ("return", "o1 return"))),
    *(Statement(f"O... {word}", _EVALUATED, "condition or loop", samples=(f"{_O}{word}",)) for word in (
        "if", "elseif", "else", "endif", "while", "endwhile", "do", "repeat", "endrepeat", "break", "continue")),
    Statement("O", _EVALUATED, "number of a subprogram", samples=("O100",)),
    Statement("N", _NEUTRAL, "block number", samples=("N10",)),
    Statement("/", _NEUTRAL, "block delete: read as executed, with a warning where the block moves", samples=("/",)),
    Statement("%", _EVALUATED, "begin and end of the program, its number or name behind it", samples=("%", "%1234")),
    Statement("( )", _NEUTRAL, "comment, message", samples=("(remark)", "(MSG, remark)", "; remark")),
    Statement("#n =", _EVALUATED, "parameter; those of the machine are not known", samples=("#100=1",)),
    Statement("#<name> =", _EVALUATED, "named parameter", samples=("#<depth>=1",)),
    Statement("F", _EVALUATED, "feed", samples=("F600",)),
    Statement("S", _EVALUATED, "spindle speed", samples=("S1000",)),
    Statement("T", _EVALUATED, "tool of the next M6", samples=("T1",)),
    Statement("H", _EVALUATED, "number of the tool length offset", samples=("G43 H1",)),
    Statement("D", _NEUTRAL, "number of the cutter radius, which G40 does not use", samples=("G40 D1",)),
    *(Statement(word, _EVALUATED, "target", samples=(f"G1 {word}1 F600",)) for word in "XYZABC"),
    *(Statement(word, _REFUSED, "axes U V W are not read", "Post X Y Z", (f"G1 {word}1",)) for word in "UVW"),
    *(Statement(word, _EVALUATED, "jump or loop of a Fanuc macro", samples=(sample,)) for word, sample in (
        ("GOTO", "GOTO 10"), ("IF", "IF [1 GT 2] GOTO 10"), ("IF THEN", "IF [1 GT 0] THEN #1=2"),
        ("WHILE", "WHILE [1 GT 2] DO1"), ("DO", "DO1"), ("END", "END1"))),
    *(Statement(word, _NEUTRAL, "output of text", samples=(f"{word}[X#1]",))
      for word in ("POPEN", "DPRNT", "BPRNT", "PCLOS")),
)  # fmt: skip


TABLE: Final = StatementTable(
    "linuxcnc",
    "G-code: LinuxCNC 2.9 (G codes, M codes, O codes), Fanuc 30i (Operator's Manual, milling) and Haas (Mill "
    "Operator's Manual)",
    (
        *(code.statement for code in (*G_CODES, *M_CODES)),
        Statement("G110 to G129", _EVALUATED, "further work offset of Haas, as G154 P1 to P20", samples=("G110",)),
        *STATEMENTS,
    ),
)
