"""System variables that a program may set, and what the reader does with each.

Source: KUKA, System Variables for KSS 8.1 to 8.6; KSS 8.3 Operating and Programming Instructions.
"""

from __future__ import annotations

from typing import Final

from counterflex.programs.statement_table import Statement, Treatment

_EVALUATED: Final = (
    ("$VEL", "$VEL={CP 0.1,ORI1 200.0,ORI2 200.0}", "path speed: CP in m/s; the speeds of orientation are carried"),
    ("$TOOL", "$TOOL=TOOL_DATA[1]", "tool frame, which must be that of the cell file"),
    ("$BASE", "$BASE=BASE_DATA[1]", "frame of the targets; a shift against the part frame is added to the path"),
    ("$OV_PRO", "$OV_PRO=100", "override in per cent, which multiplies the path speed"),
    ("$ORI_TYPE", "$ORI_TYPE=#VAR",
     "#CONSTANT keeps the orientation of the start; #VAR and #JOINT lead to that of the end"),
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
