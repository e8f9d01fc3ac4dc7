"""Instructions of INFORM III: what the reader does with each."""

from __future__ import annotations

import re
from typing import Final

from counterflex.programs.statement_table import Statement, StatementTable, Treatment

_E, _N, _R = Treatment.EVALUATED, Treatment.NEUTRAL, Treatment.REFUSED
_POST: Final = "Post the path without it"
_AS_M_CODE: Final = "Name the instruction in [controller.spindle.inform] (m_codes) of the cell file if it moves nothing"
OPTION: Final = "option "
"""Begins the key of an option of a motion."""
OPENS: Final = {"IFTHENEXP": "ENDIF", "WHILEEXP": "ENDWHILE", "FOR": "NEXT", "SWITCH": "ENDSWITCH"}
"""Instructions that begin a block, and those that end it."""


def _row(word: str, treatment: Treatment, reason: str, *samples: str, remedy: str = "") -> Statement:
    return Statement(word, treatment, reason, remedy, samples)


def _evaluated(rows: str) -> list[Statement]:
    """Rows from lines ``word | reason | sample``."""
    parts = [[part.strip() for part in line.split("|")] for line in rows.strip().splitlines()]
    return [_row(word, _E, reason, sample) for word, reason, sample in parts]


def _neutral(rows: str) -> list[Statement]:
    parts = [[part.strip() for part in line.split("|")] for line in rows.strip().splitlines()]
    return [_row(word, _N, reason, sample) for word, reason, sample in parts]


def _refused(rows: str, remedy: str) -> list[Statement]:
    parts = [[part.strip() for part in line.split("|")] for line in rows.strip().splitlines()]
    return [_row(word, _R, reason, sample, remedy=remedy) for word, reason, sample in parts]


_MOTIONS: Final = (
    *_evaluated("""
        MOVJ | rapid to a position, by axes | MOVJ C00000 VJ=10.00
        MOVL | straight motion at a speed | MOVL C00000 V=25.0
        MOVC | arcs through three or more points, the first one reached straight | MOVC C00000 V=25.0
        IMOV | straight motion by an increment in a frame that is said | IMOV P000 V=25.0 BF
        SPEED | speed of motions that name none | SPEED VJ=10.00 V=25.0
    """),
    *_neutral("REFP | reference point of welding: nothing moves | REFP 1 C00000"),
    *_refused("MOVS | the curve of a spline is the controller's own | MOVS C00000 V=25.0", "Post the path as MOVL"),
    *_refused("EIMOV | moves by an increment of two groups | EIMOV P000 V=25.0", _POST),
    *_refused("SMOVL | moves in coordination with another group | SMOVL C00000 V=25.0", _POST),
)
_OPTIONS: Final = (
    *_evaluated("""
        option PL | 0: stop; 1 to 8: rounded within a distance of the controller | MOVL C00000 V=25.0 PL=0
        option CR | radius of the corner, mm | MOVL C00000 V=25.0 CR=5.0
        option FPT | the arc changes at this point | MOVC C00000 V=25.0 FPT
        option ACC | carried: acceleration, not path or speed | MOVL C00000 V=25.0 ACC=50
        option DEC | carried: acceleration, not path or speed | MOVL C00000 V=25.0 DEC=50
        option NWAIT | carried: the next instruction begins at once | MOVL C00000 V=25.0 NWAIT
        option ENWAIT | carried: the next instruction begins before the end | MOVL C00000 V=25.0 ENWAIT T=0.50
        option COORD | carried: how the tool is held along an arc by the controller | MOVC C00000 V=25.0 COORD=0
        option BC | carried: the base axis stands still | MOVL C00000 BC00000 V=25.0
        option EC | carried: the station stands still | MOVL C00000 EC00000 V=25.0
    """),
    *_refused("""
        option VR | the speed is that of turning | MOVL C00000 VR=25.0
        option VE | the speed is that of an external axis | MOVL C00000 VE=25.0
        option UNTIL | an input ends the motion: where the robot stops is not known | MOVL C00000 V=25.0 UNTIL IN#(1)=ON
        option SRCH | an input ends the motion: where the robot stops is not known | MOVL C00000 V=25.0 SRCH RIN#(1)=ON
        option TRAP | the motion may end early | MOVL C00000 V=25.0 TRAP *A
        option PD | where the corner begins depends on the controller | MOVL C00000 V=25.0 PD=5.0
        option CV | follows a conveyor | MOVL C00000 V=25.0 CV#(1)
        option + | another group moves with it | MOVL C00000 V=25.0 +MOVL C00001 V=25.0
    """, _POST),
)  # fmt: skip
_VALUES: Final = _evaluated("""
    SET | value of a variable | SET B000 1
    SETE | element of a position variable | SETE P000 (3) 2000
    GETE | element of a position variable | GETE D000 P000 (3)
    ADD | sum | ADD B000 1
    SUB | difference | SUB B000 1
    MUL | product | MUL I000 2
    DIV | quotient of numbers that divide without rest, or real ones | DIV I000 2
    INC | adds 1 | INC B000
    DEC | subtracts 1 | DEC I000
    CLEAR | zero | CLEAR B000 1
    AND | of bits | AND B000 1
    OR | of bits | OR B000 1
    XOR | of bits | XOR B000 1
    NOT | of bits | NOT B000 B001
    SIN | of deg | SIN R000 30
    COS | of deg | COS R000 30
    ATAN | in deg | ATAN R000 1
    SQRT | square root | SQRT R000 2
    GETS | a system variable: the variable is not known then | GETS B000 $B002
    GETARG | an argument: the variable is not known then | GETARG LB000 IARG#(1)
    GETPOS | position of a step: the variable is not known then | GETPOS PX000 STEP#(1)
    GETREG | a register: the variable is not known then | GETREG I000 MREG#(1)
    CNVRT | position in another frame: the variable is not known then | CNVRT PX000 PX001 BF
    MULMAT | product of positions: the variable is not known then | MULMAT P000 P001 P002
    INVMAT | inverse of a position: the variable is not known then | INVMAT P000 P001
    MSHIFT | shift between positions: the variable is not known then | MSHIFT PX000 BF PX001 PX002
    DIN | inputs: the variable is not known then | DIN B000 IN#(1)
    AIN | inputs: the variable is not known then | AIN R000 AI#(1)
    INPUT | a person enters it: the variable is not known then | INPUT B000
    VAL | of a text: the variable is not known then | VAL B000 "1"
    MFRAME | user frame from three known positions | MFRAME UF#(9) P000 P001 P002
""")
_FLOW: Final = (
    *_evaluated("""
        * | label | *A
        JUMP | jump to a label or job, also under IF | JUMP *A IF B000=1
        CALL | a job that lies in the folder | CALL JOB:PART
        RET | end of the job | RET IF B000=1
        PAUSE | stop until a person goes on | PAUSE
        ABORT | end of all jobs | ABORT
        TIMER | dwell of a time | TIMER T=0.50
        WAIT | waits for an input | WAIT IN#(1)=ON
        IFTHENEXP | condition | IFTHENEXP B000=1
        ELSEIFEXP | further condition | ELSEIFEXP B000=2
        ELSE | other branch | ELSE
        ENDIF | end of IFTHENEXP | ENDIF
        WHILEEXP | loop under a condition | WHILEEXP B000<3
        ENDWHILE | end of WHILEEXP | ENDWHILE
        FOR | counted loop | FOR I000=1 TO 3
        NEXT | end of FOR | NEXT I000
        SWITCH | branches by the value of a variable | SWITCH I000
        CASE | branch of SWITCH | CASE 1
        DEFAULT | other branch of SWITCH | DEFAULT
        ENDSWITCH | end of SWITCH | ENDSWITCH
        SFTON | shift of all positions in a frame that is said | SFTON P000 UF#(1)
        SFTOF | end of the shift | SFTOF
    """),
    *_neutral("""
        ' | comment | 'comment
        // | instruction that is commented out | //MOVL C00000 V=25.0
        NOP | nothing | NOP
        CWAIT | ends NWAIT | CWAIT
        MSG | a message | MSG "part done"
        PRINT | a message | PRINT "part done"
        CLS | empties the screen | CLS
        SETUALM | an alarm of the user | SETUALM 8000 "stop" 0
        DOUT | an output | DOUT OT#(7) ON
        AOUT | an analog output | AOUT AO#(7) 5.0
        PULSE | a pulse of an output | PULSE OT#(7) T=0.50
        GOUT | outputs | GOUT OG#(7) 1
        SETREG | a register | SETREG MREG#(1) I000
        SETTM | a clock | SETTM TM000 TSTART
        HAND | a gripper | HAND 1 ON
        HSEN | a sensor of a gripper | HSEN 1 ON
        TOOLON | a tool is switched | TOOLON
        TOOLOF | a tool is switched | TOOLOF
        VAL2STR | text of a number | VAL2STR S000 B000
        ADVINIT | how far the controller reads ahead | ADVINIT
        ADVSTOP | how far the controller reads ahead | ADVSTOP
        HPVELON | a message of the controller | HPVELON
    """),
    *_refused("""
        SFTON3D | turns and shifts all positions | SFTON3D P000
        SYSTART | follows a conveyor | SYSTART CV#(1)
        WVON | the path swings | WVON WEV#(1)
        ARCON | a welding controller may displace the path | ARCON ASF#(1)
        COMARCON | a sensor displaces the path | COMARCON
        SETFILE | sets data of the controller | SETFILE WEV#(1) (5) 3500
        SETPRM | sets a parameter of the controller | SETPRM KIND=5 PRMNO=67 D000
        SETTOOL | sets a tool frame | SETTOOL TL#(1) P000
        PSTART | starts another job beside this one | PSTART JOB:OTHER SUB1
        PWAIT | waits for another job | PWAIT SUB1
        TSYNC | waits for another job | TSYNC 1
    """, _AS_M_CODE),
)  # fmt: skip
TABLE: Final = StatementTable(
    "inform",
    "Yaskawa, YRC1000 and DX200 Operator's manual, INFORM language; options of motions begin with `option`",
    (*_MOTIONS, *_OPTIONS, *_VALUES, *_FLOW),
)
ACTING: Final = frozenset({"DOUT", "AOUT", "PULSE", "GOUT", "WAIT", "HAND", "HSEN", "TOOLON", "TOOLOF", "SETREG"})
"""Act on the cell, and the table of the cell file may not say how."""
ASSIGNING: Final = frozenset(row.word for row in _VALUES) - {"MFRAME"}
"""Set the variable behind them, or make it unknown."""
_WORD: Final = re.compile(r"'|//|\*|\+?[A-Za-z]\w*", re.ASCII)


def row_of(code: str) -> Statement | None:
    """Row of the table of an instruction; None where it names no such one."""
    match = _WORD.match(code)
    return None if match is None else TABLE.find(match[0])
