"""All statements of KRL and what the reader does with each; system variables are in :mod:`.system_variables`.

Sources: KUKA, KSS 8.3 and 8.6 Operating and Programming Instructions for System Integrators, chapter "KRL syntax" and
the index of key words; bas.src; documentation of the options EthernetKRL and RobotSensorInterface for their functions.

System variables that a program may set, and what the reader does with each.

Source: KUKA, System Variables for KSS 8.1 to 8.6; KSS 8.3 Operating and Programming Instructions.
"""

from __future__ import annotations

from typing import Final

from counterflex.programs.statement_table import Statement, StatementTable, Treatment

_EVALUATED: Final = (
    ("$VEL", "$VEL={CP 0.1,ORI1 200.0,ORI2 200.0}", "speed along the path, CP in m/s; of turning, ORI1 and ORI2"),
    ("$TOOL", "$TOOL=TOOL_DATA[1]", "tool frame, which must be that of the cell file"),
    ("$BASE", "$BASE=BASE_DATA[1]", "frame of the targets; a shift against the part frame is added to the path"),
    ("$OV_PRO", "$OV_PRO=100", "override in per cent, which multiplies the path speed"),
    ("$ORI_TYPE", "$ORI_TYPE=#VAR",
     "#CONSTANT keeps the orientation of the start, #VAR leads to that of the end; #JOINT is refused"),
    ("$CIRC_TYPE", "$CIRC_TYPE=#BASE", "orientation on circles; #PATH with $ORI_TYPE=#CONSTANT is refused"),
    ("$IPO_MODE", "$IPO_MODE=#BASE", "#TCP, the robot holds the part, is refused"),
    ("$APO", "$APO.CDIS=0.5", "distance at which approximation begins"),
    ("$RED_VEL", "$RED_VEL=100", "reduction of the programmed speed in per cent; other than 100 is refused"),
    ("$ASYNC_AXIS", "$ASYNC_AXIS=0", "external axes that move beside the program; others than 0 are refused"),
    ("$TECH", "$TECH[1].MODE=#OFF", "function generator: adds a motion to the path; another MODE than #OFF is refused"),
    ("$TECH_C", "$TECH_C[1].MODE=#OFF", "function generator in the main run; another MODE than #OFF is refused"),
    ("$PAL_MODE", "$PAL_MODE=FALSE", "TRUE holds the flange level whatever the targets say, and is refused"),
)  # fmt: skip
ONE_VALUE: Final[dict[str, tuple[str, object, str, str]]] = {
    "$ASYNC_AXIS": ("", 0, "external axes move beside the program", "Let external axes stand in the cut"),
    "$TECH": ("MODE", "#OFF", "the function generator adds a motion to the path", "Post the path without it"),
    "$TECH_C": ("MODE", "#OFF", "the function generator adds a motion to the path", "Post the path without it"),
    "$PAL_MODE": ("", False, "the flange is held level whatever the targets say", "Leave $PAL_MODE off"),
}
"""Variables of which one value alone leaves the path as it is: component or nothing, the value, else what, remedy."""
_NEUTRAL: Final = (
    ("acceleration, jerk and speed of axes: the path stays", (
        "$ACC.CP=1.0", "$ACC_AXIS[1]=50", "$VEL_AXIS[1]=50", "$ACC_EXTAX[1]=50", "$VEL_EXTAX[1]=50", "$JERK.CP=50.0",
        "$GEAR_JERK[1]=50", "$ACC_MA.CP=10.0", "$VEL_MA.CP=3.0", "$ACC_ORI1=100", "$ECO_LEVEL=#OFF",
        "$ACC_CAR_TOOL.X=1.0",
        "$OV_ASYNC=100", "$OV_JOG=10", "$RED_ACC_ECO_LEVEL=1", "$DYN_DAT=1", "$CP_VEL_TYPE=#CONSTANT",
        "$SPL_VEL_MODE=#OPT", "$APO_DIS_PTP[1]=90.0", "$ACC_C.CP=1.0", "$VEL_C.CP=0.1",
        "$SPL_ORI_JOINT_AUTO=#ON", "$FAST_MEAS_COUNT_RESET=TRUE",
    )),
    ("load for dynamics and monitoring: the path stays", (
        "$LOAD={M 12.0,CM {X 0.0,Y 0.0,Z 100.0,A 0.0,B 0.0,C 0.0}}", "$LOAD_A1.M=0.0", "$LOAD_A2.M=0.0",
        "$LOAD_A3.M=0.0",
    )),
    ("how far the controller reads ahead, or from where backward: the path stays", (
        "$ADVANCE=3", "$BWDSTART=FALSE", "$H_POS=XHOME", "$BWD_INFO=1", "$VW_BACKWARD=#TRACE_OFF",
        "$VW_MOVEMENT=#TRACE_OFF",
    )),
    ("display and numbers of the inline forms: the path stays", (
        "$ACT_TOOL=1", "$ACT_BASE=1", "$ACT_EX_AX=0", "$ACT_TOOL_C=1", "$ACT_BASE_C=1", "$TOOL_C=TOOL_DATA[1]",
        "$TSYS=#BASE", "$COORD=#BASE", "$LANGUAGE=1", "$TEXT[]=\"X\"", "$INPOSITION=1",
    )),
    ("an output or flag: switches something", (
        "$OUT[1]=TRUE", "$OUT_C[1]=TRUE", "$ANOUT[1]=0.5", "$FLAG[1]=TRUE", "$CYCFLAG[1]=$IN[2]",
        "$PING_COMMAND[]=\"X\"",
        "$USER_SAF_OUT=TRUE", "$IOBUS_INFO[1]=1",
    )),
    ("timers and counters: read values are not known", (
        "$TIMER[1]=0", "$TIMER_STOP[1]=FALSE", "$TIMER_FLAG[1]=FALSE", "$COUNT_I[1]=1", "$LOOP_MSG[]=\"X\"",
    )),
    ("collision, torque and workspace monitoring: may stop the robot, the path stays", (
        "$TORQMON_DEF[1]=200", "$TORQMON[1]=200", "$TORQMON_COM[1]=200", "$TORQMON_COM_DEF[1]=200",
        "$COLLMON_TOL_PRO[1]=0",
        "$TORQ_DIFF[1]=0", "$TORQ_DIFF2[1]=0", "$WORKSPACE[1].MODE=#OFF", "$AXWORKSPACE[1].MODE=#OFF",
        "$HOLDING_TORQUE[1]=0.0",
        "$COLL_ENABLE=FALSE", "$CMD_TORQUE_LIMITS=TRUE", "$SOFTN_END[1]=-180.0", "$SOFTP_END[1]=180.0",
        "$PATH_DEV_MON=TRUE", "$MON_PATH_TOL=5.0", "$BRK_MODE=0", "$BRAKE_SIG=0", "$ALARM_STOP_INT=TRUE",
        "$DRIVES_OFF=FALSE", "$STOPMB_ID=0", "$CYC_DEF[1].AA[]=\"X\"",
    )),
    ("data of sensors, applications and automatic operation: the path stays", (
        "$SEN_PINT[1]=0", "$SEN_PREA[1]=0.0", "$SEN_PINT_C[1]=0", "$SEN_PREA_C[1]=0.0",
        "$PRO_I_O[]=\"/R1/SPS()\"", "$PRO_MODE=#GO", "$PRO_MODE1=#GO", "$RC_RDY1=TRUE",
        "$INTERPRETER=1",
        "$DATAPATH=1", "$ON_PATH=FALSE", "$ERR.NUMBER=0", "$TRACE.MODE=#T_STOP", "$MSG_T.VALID=FALSE",
        "$MSG_T.KEY[]=\"X\"",
        "$UTS=0", "$WAITSTATE=FALSE", "$EXT_START=FALSE", "$MOVE_ENABLE=TRUE", "$APPL_RUN=TRUE", "$PGNO_VALID=1",
        "$PR_MODE=#GO", "$TARGET_STATUS=#SOURCE", "$EX_AX_IGNORE=0", "$SINGUL_POS[1]=0", "$SINGUL_STRATEGY=0",
        "$ORI_CHECK=0", "$CP_STATMON=#JOINT", "$TECHPAR[1,1]=0.0", "$TECHVAL[1]=0.0", "$SOFTPLCBOOL[1]=TRUE",
        "$SOFTPLCINT[1]=0", "$SOFTPLCREAL[1]=0.0", "$REVO_NUM[1]=0", "$IPO_WAIT_FOR=TRUE", "$PATHTIME=1", "$VCP_IP=1",
        "$SINGUL_ERR_PRO[1]=0", "$SYNC=0", "$DISTANCE=0.0", "$REDUNDANCY=0.0",
    )),
)  # fmt: skip
_REFUSED: Final = (
    ("$MAMES[1]=0.0", "moves the zero of an axis: all places of the robot are others",
     "Master the robot outside of the program"),
    ("$ROBROOT={X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}", "moves the robot in its world",
     "Set $BASE, or [part] of the cell file"),
    ("$ERSYSROOT={X 0.0}", "moves the robot by an external axis", "Let external axes stand in the cut"),
    ("$ET1_TA1KR={X 0.0}", "changes an external kinematic system", "Let external axes stand in the cut"),
    ("$TOOL_DIRECTION=#X", "names the working direction of the tool otherwise", "Give the tool frame itself"),
    ("$COMPLIANCE=1", "the axes yield under force (soft servo)", "Mill with stiff axes"),
    ("$CURR_RED[1,1]=50", "the axes yield under force (soft servo)", "Mill with stiff axes"),
    ("$TORQUE_AXIS=1", "an axis follows a torque instead of the path", "Mill with stiff axes"),
    ("$POSCORR.X=0.0", "displaces the path", "Add the displacement to $BASE"),
    ("$OFFSET.X=0.0", "displaces the path", "Add the displacement to $BASE"),
    ("$ADAP_ACC=#NONE", "changes machine data", "Set it in the machine data"),
    ("$TOUCH[1]=1", "moves the robot to a touch sensor", "Measure outside of the program"),
)  # fmt: skip


def _word(sample: str) -> str:
    name = sample.split("=", 1)[0]
    return name.split("[")[0].split(".")[0]


def _unique(rows: tuple[Statement, ...]) -> tuple[Statement, ...]:
    return tuple({row.word: row for row in rows}.values())


SYSTEM_VARIABLES: Final = _unique((
    *(Statement(word, Treatment.EVALUATED, reason, "", (sample,)) for word, sample, reason in _EVALUATED),
    *(Statement(_word(sample), Treatment.NEUTRAL, reason, "",
    (sample,)) for reason, group in _NEUTRAL for sample in group),
    *(Statement(_word(sample), Treatment.REFUSED, reason, remedy, (sample,)) for sample, reason, remedy in _REFUSED),
))  # fmt: skip
"""A row per variable; its components and elements are in the same row."""


def _rows(treatment: Treatment, reason: str, *rows: tuple[str, str], remedy: str = "") -> tuple[Statement, ...]:
    return tuple(Statement(word, treatment, reason, remedy, (sample,)) for word, sample in rows)


def _evaluated(reason: str, *rows: tuple[str, str]) -> tuple[Statement, ...]:
    return _rows(Treatment.EVALUATED, reason, *rows)


def _neutral(reason: str, *rows: tuple[str, str]) -> tuple[Statement, ...]:
    return _rows(Treatment.NEUTRAL, reason, *rows)


def _refused(reason: str, remedy: str, *rows: tuple[str, str]) -> tuple[Statement, ...]:
    return _rows(Treatment.REFUSED, reason, *rows, remedy=remedy)


_MOTIONS: Final = (
    *_evaluated("straight motion at $VEL.CP", ("LIN", "LIN {X 1.0}"), ("SLIN", "SLIN {X 1.0}")),
    *_evaluated("circle through an auxiliary point; CA decides about its length",
                ("CIRC", "CIRC {X 5.0,Y 5.0},{X 10.0,Y 0.0}"), ("SCIRC", "SCIRC {X 5.0,Y 5.0},{X 10.0,Y 0.0}")),
    *_evaluated("rapid; by axis angles its end follows from the robot of the cell file",
                ("PTP", "PTP {X 1.0}"), ("SPTP", "SPTP {X 1.0}")),
    *_evaluated("motion by an amount from where the robot is, in $BASE or #TOOL",
                ("LIN_REL", "LIN_REL {X 1.0}"), ("SLIN_REL", "SLIN_REL {X 1.0}"), ("PTP_REL", "PTP_REL {X 1.0}"),
                ("SPTP_REL", "SPTP_REL {X 1.0}")),
    *_refused("the points of a relative circle count from where the robot is", "Post the circle with absolute points",
              ("CIRC_REL", "CIRC_REL {X 5.0,Y 5.0},{X 10.0}"), ("SCIRC_REL", "SCIRC_REL {X 5.0,Y 5.0},{X 10.0}")),
    *_evaluated("block of SLIN and SCIRC, with a speed of its own", ("SPLINE", "SPLINE"), ("ENDSPLINE", "ENDSPLINE")),
    *_refused("the curve of this word is the controller's own and is not known", "Post the path as SLIN",
              ("SPL", "SPL {X 1.0}"), ("SPL_REL", "SPL_REL {X 1.0}"), ("PTP_SPLINE", "PTP_SPLINE"),
              ("TIME_BLOCK START", "TIME_BLOCK START"), ("TIME_BLOCK PART", "TIME_BLOCK PART = 50"),
              ("TIME_BLOCK END", "TIME_BLOCK END = 2.0"), ("CONST_VEL START", "CONST_VEL START = 10"),
              ("CONST_VEL END", "CONST_VEL END = 10"), ("STOP WHEN PATH", "STOP WHEN PATH = 5 IF $IN[1]")),
)  # fmt: skip
_FLOW: Final = (
    *_evaluated("head and end of a routine",
                ("DEF", "DEF PART( )"), ("END", "END"), ("DEFFCT", "DEFFCT INT F(X:IN)"), ("ENDFCT", "ENDFCT")),
    *_evaluated("executed where its condition is known; where it is not, nothing in it may move the robot",
                ("IF", "IF N>0 THEN"), ("ELSE", "ELSE"), ("ENDIF", "ENDIF"), ("SWITCH", "SWITCH N"), ("CASE", "CASE 1"),
                ("DEFAULT", "DEFAULT"), ("ENDSWITCH", "ENDSWITCH")),
    *_evaluated("repeated as often as its values say", ("FOR", "FOR I=1 TO 3"), ("ENDFOR", "ENDFOR"),
                ("WHILE", "WHILE I<3"), ("ENDWHILE", "ENDWHILE"), ("REPEAT", "REPEAT"), ("UNTIL", "UNTIL I>3"),
                ("LOOP", "LOOP"), ("ENDLOOP", "ENDLOOP"), ("EXIT", "EXIT")),
    *_evaluated("jump within the routine", ("GOTO", "GOTO AGAIN"), ("LABEL:", "AGAIN:")),
    *_evaluated("end of a routine, with the value of a function", ("RETURN", "RETURN")),
    *_evaluated("subprogram of the file or of a file of the folder, with its arguments", ("NAME( )", "CUT(5.0)")),
    *_evaluated("value of a variable, component or element", ("NAME =", "N=5")),
    *_evaluated("the tool stays", ("WAIT SEC", "WAIT SEC 0.5")),
    *_evaluated("stop until a person presses start: M0", ("HALT", "HALT")),
    *_neutral("waits: the tool stays where it is", ("WAIT FOR", "WAIT FOR $IN[2]")),
    *_neutral("prevents a stop of the advance run, moves nothing", ("CONTINUE", "CONTINUE")),
    *_refused("the program is continued in another routine, when is not known",
    "Post the path without interrupts that end it",
              ("RESUME", "RESUME")),
    *_neutral("stops the robot within an interrupt; it goes on along the path", ("BRAKE", "BRAKE")),
    *_neutral("a fault of the next statement does not stop the program", ("ON_ERROR_PROCEED", "ON_ERROR_PROCEED")),
)  # fmt: skip
_DECLARATIONS: Final = (
    *_evaluated("declares variables; types round values", ("DECL", "DECL INT N")),
    *_neutral("declares a type", ("STRUC", "STRUC SPOT REAL TIME,FRAME PLACE"), ("ENUM", "ENUM COLOUR RED,GREEN")),
    *_neutral("names an input or output", ("SIGNAL", "SIGNAL CHIPS $OUT[12]")),
    *_neutral("declares a routine of another file", ("EXT", "EXT BAS(BAS_COMMAND :IN,REAL :IN)"),
              ("EXTP", "EXTP VENDOR(INT :IN)"), ("EXTFCT", "EXTFCT INT F(INT :IN)")),
    *_evaluated("name of a variable of another data list", ("IMPORT", "IMPORT FRAME MILL IS /R1/FRAMES..MILL")),
)  # fmt: skip
_OUTPUTS: Final = (
    *_neutral("switches an output", ("PULSE", "PULSE($OUT[4],TRUE,0.2)"), ("ANOUT ON", "ANOUT ON CHANNEL=1.0*$VEL_ACT"),
              ("ANOUT OFF", "ANOUT OFF CHANNEL"), ("SYN OUT", "SYN OUT 5 'X' STATE=TRUE AT START DELAY=0"),
              ("SYN PULSE", "SYN PULSE 5 'X' STATE=TRUE TIME=0.1 AT START DELAY=0")),
    *_neutral("reads an analog input into a variable", ("ANIN ON", "ANIN ON SIGNAL_1=1.0*CHANNEL_1"),
              ("ANIN OFF", "ANIN OFF CHANNEL_1")),
    *_evaluated("an output, or a machine function of the cell file, at a place of the path; a subprogram must not move",
                ("TRIGGER WHEN DISTANCE", "TRIGGER WHEN DISTANCE=0 DELAY=0 DO $OUT[1]=TRUE"),
                ("TRIGGER WHEN PATH", "TRIGGER WHEN PATH=0 DELAY=0 DO $OUT[1]=TRUE")),
    *_evaluated("its routine must not move the robot, and what it sets is not known",
                ("INTERRUPT DECL", "INTERRUPT DECL 5 WHEN $IN[1] DO $OUT[1]=TRUE")),
    *_neutral("switches an interrupt", ("INTERRUPT ON", "INTERRUPT ON 3"), ("INTERRUPT OFF", "INTERRUPT OFF 3"),
              ("INTERRUPT ENABLE", "INTERRUPT ENABLE 3"), ("INTERRUPT DISABLE", "INTERRUPT DISABLE 3")),
    *_refused("moves external axes beside the program", "Let external axes stand in the cut",
              ("ASYPTP", "ASYPTP {E1 10.0}"), ("ASYCONT", "ASYCONT 'H10'")),
    *_neutral("stops asynchronous external axes", ("ASYSTOP", "ASYSTOP 'H10'"), ("ASYCANCEL", "ASYCANCEL 'H10'")),
)  # fmt: skip
_BAS: Final = (
    *_evaluated("base: the world, speed: DEF_VEL_CP, until the program sets them again",
                ("BAS #INITMOV", "BAS(#INITMOV,0)")),
    *_evaluated("path speed", ("BAS #VEL_CP", "BAS(#VEL_CP,0.1)")),
    *_evaluated("path speed, tool and base of LDAT_ACT and FDAT_ACT",
                ("BAS #CP_PARAMS", "BAS(#CP_PARAMS,0.1)"), ("BAS #CP_DAT", "BAS(#CP_DAT)")),
    *_evaluated("tool and base of FDAT_ACT", ("BAS #FRAMES", "BAS(#FRAMES)"), ("BAS #PTP_PARAMS",
    "BAS(#PTP_PARAMS,30)")),
    *_evaluated("tool", ("BAS #TOOL", "BAS(#TOOL,1)")),
    *_evaluated("base", ("BAS #BASE", "BAS(#BASE,1)")),
    *_neutral("speed or acceleration of axes, or acceleration: the path stays",
              ("BAS #VEL_PTP", "BAS(#VEL_PTP,30)"), ("BAS #ACC_PTP", "BAS(#ACC_PTP,50)"), ("BAS #ACC_CP",
               "BAS(#ACC_CP,50)"),
              ("BAS #ACC_ORI", "BAS(#ACC_ORI,50)"), ("BAS #ACC_ORI1", "BAS(#ACC_ORI1,50)"),
              ("BAS #ACC_ORI2", "BAS(#ACC_ORI2,50)"), ("BAS #VEL_ORI", "BAS(#VEL_ORI,100)"),
              ("BAS #VEL_ORI1", "BAS(#VEL_ORI1,100)"), ("BAS #VEL_ORI2", "BAS(#VEL_ORI2,100)"),
              ("BAS #PTP_DAT", "BAS(#PTP_DAT)"), ("BAS #OUT_WERKZEUG", "BAS(#OUT_WERKZEUG,0)"),
              ("BAS #OUT_SAK", "BAS(#OUT_SAK,0)")),
    *_refused("a base that external axes move", "Let external axes stand: set $BASE itself", ("BAS #EX_BASE",
    "BAS(#EX_BASE,3)")),
)  # fmt: skip
_LIBRARY: Final = (
    *_neutral("reads or writes a file, a channel or a message; results are not known",
              *((name, f"{name}( )") for name in (
                  "COPEN", "CCLOSE", "CREAD", "CWRITE", "CIOCTL", "SREAD", "SWRITE", "CAST_TO", "CAST_FROM",
                  "KRL_FOPEN", "KRL_FCLOSE", "KRL_FGETS", "KRL_FGETC", "KRL_FSCANF", "KRL_FPUTS", "KRL_FPUTC",
                  "KRL_FPRINTF", "KRL_FEOF", "MSGNOTIFY", "MSGQUIT", "MSGWAIT", "MSGDIALOG", "MSGLOADER", "SET_KRLMSG",
                  "SET_KRLDLG", "CLEAR_KRLMSG", "EXISTS_KRLMSG", "EXISTS_KRLDLG", "GET_KRLMSG", "SET_KRLDLGANSWER",
                  "STRADD", "STRCLEAR", "STRCOMP", "STRCOPY", "STRDECLLEN", "STRFIND", "STRLEN", "VARSTATE",
                  "GETVARSIZE", "GET_SIG_INF", "GETSYSSTATE", "MBX_REC", "M_COMMENT"))),
    *_neutral("talks to another computer (EthernetKRL); results are not known",
              *((name, f"RET={name}( )") for name in (
                  "EKI_INIT", "EKI_OPEN", "EKI_CLOSE", "EKI_CLEAR", "EKI_SEND", "EKI_CHECKBUFFER", "EKI_CLEARBUFFER",
                  "EKI_GETBOOL", "EKI_GETBOOLARRAY", "EKI_GETINT", "EKI_GETINTARRAY", "EKI_GETREAL",
                  "EKI_GETREALARRAY", "EKI_GETSTRING", "EKI_GETFRAME", "EKI_GETFRAMEARRAY", "EKI_SETREAL",
                  "EKI_SETINT", "EKI_SETBOOL", "EKI_SETFRAME", "EKI_SETSTRING", "EKI_LOCK", "EKI_UNLOCK",
                  "EKI_CHECK"))),
    *_neutral("sensor correction on top of the path (RobotSensorInterface); RSI_ON is named in a warning",
              *((name, f"RET={name}( )") for name in (
                  "RSI_CREATE", "RSI_DELETE", "RSI_ON", "RSI_OFF", "RSI_RESET", "RSI_DISABLE", "RSI_ENABLE",
                  "RSI_SETPUBLICPAR", "RSI_GETPUBLICPAR", "RSI_CHECKID"))),
    *_refused("moves the robot as a sensor says", "Leave the sensor-guided motion out of the program",
              ("RSI_MOVECORR", "RSI_MOVECORR( )")),
    *_neutral("initialises an application package, moves nothing",
              ("USERSPOT", "USERSPOT(#INIT)"), ("USER_GRP", "USER_GRP(0,DUMMY,DUMMY,GDEFAULT)"), ("A10_INI",
               "A10_INI( )"),
              ("A20_INI", "A20_INI( )"), ("ARCON_INI", "ARCON_INI( )"), ("H70", "H70(6,CDEFAULT)"),
              ("SET_CD_PARAMS", "SET_CD_PARAMS(0)"), ("USE_CM_PRO_VALUES", "RET=USE_CM_PRO_VALUES(0)"),
              ("TM_SON", "TM_SON(TMDEFAULT)"), ("TM_SOFF", "TM_SOFF(TMDEFAULT)")),
    *_neutral("steps of Automatic External: handshake of outputs", ("P00", "P00(#INIT_EXT,#PGNO_GET,DMY[],0)")),
    *_neutral("stops or releases the robot, or deletes the path for backward motion; it goes on along the path",
              ("ROB_STOP", "ROB_STOP(#RAMP_DOWN)"), ("ROB_STOP_RELEASE", "ROB_STOP_RELEASE( )"),
              ("DELETE_BACKWARD_BUFFER", "DELETE_BACKWARD_BUFFER( )"), ("SET_BRAKE_DELAY", "SET_BRAKE_DELAY(200)"),
              ("SYNCCMD", "SYNCCMD(#SYNC_POINT,NAME[],'H3')")),
    *_evaluated("arithmetic", ("ABS", "R=ABS(-1.0)"), ("SQRT", "R=SQRT(2.0)"), ("SIN", "R=SIN(30.0)"), ("COS",
    "R=COS(30.0)"),
                ("TAN", "R=TAN(30.0)"), ("ACOS", "R=ACOS(0.5)"), ("ATAN2", "R=ATAN2(1.0,2.0)"),
                ("INV_POS", "FR=INV_POS({X 1.0})")),
    *_neutral("computes something that is not known here; a use of the result is refused",
              ("FORWARD", "PT=FORWARD(AX,ERR)"), ("INVERSE", "AX=INVERSE(PT,AX,ERR)"), ("EK", "FR=EK(FR,#EASYS,FR)"),
              ("EB", "FR=EB(FR,#EASYS,FR)"), ("EO", "PT=EO(#EASYS,PT)")),
)  # fmt: skip
TABLE: Final = StatementTable(
    "krl",
    "KUKA KSS 8.3 and 8.6, Operating and Programming Instructions for System Integrators (KRL syntax), bas.src, and "
    "writable system variables",
    (*_MOTIONS, *_FLOW, *_DECLARATIONS, *_OUTPUTS, *_BAS, *_LIBRARY, *SYSTEM_VARIABLES),
)
WORDS: Final = frozenset(row.word.upper() for row in TABLE.rows if row.word[0].isalpha() and row not in _LIBRARY)
"""Words that begin a statement; functions of libraries are called like subprograms."""
ACTING: Final = frozenset(
    ("WAIT FOR", "PULSE", "ANOUT ON", "ANOUT OFF", "SYN OUT", "SYN PULSE", "TRIGGER WHEN DISTANCE", "TRIGGER WHEN PATH",
     "INTERRUPT DECL", "INTERRUPT ON", "INTERRUPT OFF", "INTERRUPT ENABLE", "INTERRUPT DISABLE", "BRAKE", "HALT",
     "ASYSTOP", "ASYCANCEL", "$OUT", "$OUT_C", "$ANOUT", "$FLAG", "$CYCFLAG", *(row.word for row in _LIBRARY
      if row.treatment is Treatment.NEUTRAL and not row.word.startswith(("STR", "VARSTATE", "GETVARSIZE", "USER", "A10",
      "A20", "ARCON", "H70", "SET_CD", "USE_CM", "FORWARD", "INVERSE", "EK", "EB", "EO"))))
)  # fmt: skip
"""Statements that act on the cell, which another language would lose."""
