"""Statements, instructions and functions of RAPID, and what the reader does with each.

The lists follow the manual: RAPID instructions, functions and data types, 3HAC050917, RobotWare 6, and the statements
of the RAPID overview, 3HAC050947. Neutral and refused rows are written as samples; their first word is the instruction.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from counterflex.integrations.abb.language.table_neutral import NEUTRAL_GROUPS
from counterflex.programs.statement_table import Statement, StatementTable, Treatment

REFUSED_GROUPS: Final[tuple[tuple[str, str, tuple[str, ...]], ...]] = (
    (
        "the motion ends where a sensor says",
        "Measure first, and write the place into the program",
        (
            "SearchL di1,found,p10,v100,tool0;", "SearchC di1,found,p10,p20,v100,tool0;",
            "SearchExtJ di1,found,j10,v100;", "ContactL p10,v100,tool0;", "FCAct tool0;", "FCDeact;",
            "FCCalib load0;", "FCRefStart;", "FCRefStop;", "FCPress1LStart p10,v10,10,tool0;",
            "FCPressL p10,v10,10,tool0;", "FCPressC p10,p20,v10,10,tool0;", "FCPressEnd p10,v10,tool0;",
            "FCSpdChgAct FC_TORQUE;", "FCSpdChgDeact;", "FCCondWaitWhile;", "FCCondForce;", "FCCondOrient;",
            "FCCondPos;", "FCCondReoriSpeed;", "FCCondTCPSpeed;", "FCCondTorque;", "FCRefCircle;", "FCRefForce;",
            "FCRefLine;", "FCRefMoveFrame;", "FCRefRot;", "FCRefSpiral;", "FCRefSprForceCart;", "FCRefTorque;",
            "FCResetDampingTune;", "FCResetLPFilterTune;", "FCSetDampingTune;", "FCSetLPFilterTune;",
            "FCSpdChgTunReset;", "FCSpdChgTunSet;", "FCSupvForce;", "FCSupvOrient;", "FCSupvPos;",
            "FCSupvReoriSpeed;", "FCSupvTCPSpeed;", "FCSupvTorque;",
        ),
    ),
    (
        "a sensor or computer moves the robot",
        "Leave EGM to counterflex, or post the path without it",
        (
            "EGMActJoint egm1;", "EGMActMove egm1,frame1;", "EGMActPose egm1,frame1,0,frame1,0;", "EGMGetId egm1;",
            "EGMMoveC egm1,p10,p20,v10,fine,tool0;", "EGMMoveL egm1,p10,v10,fine,tool0;", "EGMReset egm1;",
            "EGMRunJoint egm1,EGM_STOP_HOLD;", "EGMRunPose egm1,EGM_STOP_HOLD;", 'EGMSetupAI ROB_1,egm1,"default";',
            'EGMSetupAO ROB_1,egm1,"default";', 'EGMSetupGI ROB_1,egm1,"default";',
            'EGMSetupLTAPP ROB_1,egm1,"a","b",1;', 'EGMSetupUC ROB_1,egm1,"default","dev";',
            "EGMStop egm1,EGM_STOP_HOLD;", "EGMStreamStart egm1;", "EGMStreamStop egm1;", "CorrCon corr1;",
            "CorrDiscon corr1;", "CorrWrite corr1,offset1;", "CorrClear;",
        ),
    ),
    (
        "a conveyor or another robot decides where and how fast it goes",
        "Post the path without it",
        (
            "WaitWObj wobj1;", "DropWObj wobj1;", "WaitSensor Ssync1;", "DropSensor Ssync1;",
            "SyncToSensor Ssync1\\On;", "SupSyncSensorOn Ssync1,1,2,3;", "SupSyncSensorOff Ssync1;",
            'PrxActivAndStoreRecord Ssync1,1,"a";', "PrxActivRecord Ssync1,1;", "PrxDbgStoreRecord Ssync1;",
            "PrxDeactRecord Ssync1;", "PrxResetPos Ssync1;", "PrxResetRecords Ssync1;", "PrxSetPosOffset Ssync1,1;",
            "PrxSetRecordSampleTime Ssync1,1;", "PrxSetSyncalarm Ssync1;", "PrxStartRecord Ssync1,1;",
            "PrxStopRecord Ssync1;", "PrxStoreRecord Ssync1,1;", 'PrxUseFileRecord Ssync1,"a";',
            "ActivateProfile cnv1;", "DeactProfile cnv1;", "LoadProfile cnv1;", "RecordProfile cnv1;",
            "StoreProfile cnv1;", "WaitAndRecProf cnv1;", "UseACCProfile cnv1;", "UseReachableTargets cnv1;",
            "IndCnvAddObject cnv1;", "IndCnvDisable cnv1;", "IndCnvEnable cnv1;", "IndCnvInit cnv1;",
            "IndCnvReset cnv1;", "SyncMoveOn sync1,tasks;", "SyncMoveOff sync1;", "SyncMoveSuspend;",
            "SyncMoveResume;", "SyncMoveUndo;", "CnvGenInstr cnv1;", "CnvSync cnv1,wobj1;",
        ),
    ),
    (
        "displaces by where the robot stands",
        "Write PDispSet, or the displaced targets themselves",
        (
            "EOffsOn\\ExeP:=p20,p10;", "EOffsOff;",
        ),
    ),
    (
        "the robot yields, so that it leaves its path",
        "Post the path without soft servos",
        (
            "SoftAct 1,50;", "SetLeadThrough;", "SoftElbow;", "CSSAct REFFRAME_TOOL;", "CSSDeact;",
            "CSSForceOffsetAct;", "CSSForceOffsetDeact;", "CSSOffsetTune;",
        ),
    ),
    (
        "an external axis moves by itself",
        "External axes stand still in the cut: take it out",
        (
            "IndAMove STN_1,1\\ToAbsNum:=90,20;", "IndCMove STN_1,1,20;", "IndDMove STN_1,1,90,20;",
            "IndRMove STN_1,1\\ToRelNum:=90,20;", "IndReset STN_1,1;", "HollowWristReset;", "STClose gun1,100,5;",
            "STOpen gun1;", "STCalib gun1\\ToolChg;", "STIndGun gun1,1;", "STIndGunReset gun1;", "CalibJ gun1;",
            "CalibL gun1;", "MeasureWearL p10;", "STTune gun1,1,1;", "STTuneReset gun1;", "ManLoadIdProc;",
            "LoadId TOOL_LOAD_ID,1,tool0;",
        ),
    ),
    (
        "drops or repeats motions of the path",
        "Post the path without it",
        (
            "ClearPath;", "WarmStart;", "StepBwdPath 1,1;", "PathRecStart id1;", "PathRecStop;", "PathRecMoveBwd;",
            "PathRecMoveFwd;",
        ),
    ),
    (
        "changes data by a name in a string",
        "Assign the value itself",
        (
            'SetDataVal "name",count;', 'SetAllDataVal "num",0;',
        ),
    ),
    (
        "measures or changes tool and base frames",
        "Write the measured frame into the program or the cell file",
        (
            "MToolTCPCalib j1,j2,j3,j4,tool1,e1,e2;", "MToolRotCalib j1,j2,tool1;",
            "SToolTCPCalib p1,p2,p3,p4,tool1,e1,e2;", "SToolRotCalib p1,p2,tool1;",
        ),
    ),
    (
        "process instructions of an option move the robot in ways of their own",
        "Post the path with MoveL and MoveC, process signals as statements of their own",
        (
            "ArcL p10,v10,seam1,weld1,z1,tool0;", "ArcLStart p10,v10,seam1,weld1,fine,tool0;",
            "ArcLEnd p10,v10,seam1,weld1,fine,tool0;", "ArcC p10,p20,v10,seam1,weld1,z1,tool0;",
            "ArcCStart p10,p20,v10,seam1,weld1,fine,tool0;", "ArcCEnd p10,p20,v10,seam1,weld1,fine,tool0;",
            "ArcRefresh;", "SpotL p10,vmax,gun1,spot1,tool0;", "SpotJ p10,vmax,gun1,spot1,tool0;",
            "SpotML p10,vmax,gun1,spot1,tool0;", "SpotMJ p10,vmax,gun1,spot1,tool0;",
            "DispL p10,v250,bead1,z10,tool0;", "DispC p10,p20,v250,bead1,z10,tool0;", "PaintL p10,v100,z10,tool0;",
            "PaintC p10,p20,v100,z10,tool0;", "NutL p10,v100,gun1,tool0;", "NutJ p10,v100,gun1,tool0;",
            "CapL p10,v100,cap1,z10,tool0;", "CapC p10,p20,v100,cap1,z10,tool0;", "ArcMoveExtJ j10,v100,fine;",
                        "MovePnP p10,p20,v100,z10,tool0;",
        ),
    ),
    (
        "stands where it always acts: the handler of errors decides what follows",
        "Post the path without it",
        (
            "RAISE;", "RaiseToUser\\Continue;", "RETRY;", "TRYNEXT;",
        ),
    ),
)  # fmt: skip
"""Reason, remedy, and a complete sample of each; its first word is the instruction."""


COMPUTED: Final = (
    "Offs(p10,1,2,3)", "RelTool(p10,1,2,3\\Rx:=5)", "PoseMult(pose1,pose2)", "PoseInv(pose1)", "PoseVect(pose1,pos1)",
    "OrientZYX(10,20,30)", "EulerZYX(\\X,q1)", "NOrient(q1)", "DefFrame(p10,p20,p30)", "ORobT(p10)",
    "Distance(pos1,pos2)", "DotProd(pos1,pos2)", "VectMagn(pos1)", "Abs(n)", "AbsDnum(n)", "Sqrt(n)", "SqrtDnum(n)",
    "Exp(n)", "Pow(n,2)", "PowDnum(n,2)", "Max(1,2)", "Min(1,2)", "Round(n\\Dec:=1)", "RoundDnum(n)", "Trunc(n)",
    "TruncDnum(n)", "NumToDnum(n)", "DnumToNum(n)", "Sin(n)", "Cos(n)", "Tan(n)", "ASin(0.5)", "ACos(0.5)", "ATan(n)",
    "ATan2(1,n)", "SinDnum(n)", "CosDnum(n)", "TanDnum(n)", "ASinDnum(0.5)", "ACosDnum(0.5)", "ATanDnum(n)",
    "ATan2Dnum(1,n)", "Dim(list1,1)", "ValToStr(n)", "NumToStr(n,2)", "StrLen(s)", "StrPart(s,1,2)",
    "StrMatch(s,1,\"a\")", "BitAnd(b,1)", "BitOr(b,1)", "BitXOr(b,1)", "BitLSh(b,1)", "BitRSh(b,1)", "BitCheck(b,1)",
    "Present(opt1)",
)  # fmt: skip
REQUESTS: Final[tuple[tuple[str, tuple[str, ...]], ...]] = (
    (
        "where the robot stands",
        (
            "CRobT()", "CJointT()", "CPos()", "CTool()", "CWObj()", "ReadMotor(1)", "CalcRobT(j10,tool0)",
            "CalcJointT(p10,tool0)", "CalcRotAxisFrame(STN_1,list1,4)", "CalcRotAxFrameZ(list1,4,p10,p20)",
            "GetMotorTorque(1)", "PathLengthGet()", "RobOS()", "GetAxisDistance(1)", "GetAxisMoveTime(1)",
            "MirPos(p10,p20)", "DefDFrame(p1,p2,p3,p4,p5,p6)", "DefAccFrame(list1,list2,4,n)", "CorrRead()",
            "IndInpos(STN_1,1)", "IndSpeed(STN_1,1\\InSpeed)", "CSpeedOverride()", "MaxRobSpeed()",
            "MaxExtLinearSpeed(STN_1)", "MaxExtReorientSpeed(STN_1)", "GetMecUnitName(ROB_1)", "PathLevel()",
            "PathRecValidBwd()", "PathRecValidFwd()", "ParIdPosValid(1,p10,list1)", "ParIdRobValid(1)",
            "EGMGetState(egm1)",
        ),
    ),
    (
        "an input or output of the cell",
        (
            "TestDI(di1)", "DInput(di1)", "DOutput(do1)", "AInput(ai1)", "AOutput(ao1)", "GInput(gi1)",
            "GInputDnum(gi1)", "GOutput(go1)", "GOutputDnum(go1)", 'IOUnitState("board")', "ValidIO(di1)",
            "GetSignalOrigin(di1,s)", "TestSignRead(1)", "GetTSPStatus(1)",
        ),
    ),
    (
        "a person's answer",
        (
            "UIMessageBox(\\Message:=\"a\")", "UIDnumEntry()", "UIDnumTune(n,1)", "UINumEntry()", "UINumTune(n,1)",
            "UIListView(list1)", "UIAlphaEntry()", "UIClientExist()",
        ),
    ),
    (
        "time and the date",
        (
            "ClkRead(clock1)", "CDate()", "CTime()", "GetTime(\\Hour)", 'FileTimeDnum("a")', 'ModTimeDnum("a")',
            'FileTime("a")', 'ModTime("a")',
        ),
    ),
    (
        "state of the controller",
        (
            "OpMode()", "IsLeadThrough()", 'ModExist("a")', "PrxGetMaxRecordpos(Ssync1)", "STCalcForce(gun1,1)",
            "STCalcTorque(gun1,1)", "STIsCalib(gun1)", "STIsClosed(gun1,n)", "STIsIndGun(gun1)", "STIsOpen(gun1)",
            "SafetyControllerGetChecksum()", "SafetyControllerGetOpModePinCode()", "SafetyControllerGetSWVersion()",
            "SafetyControllerGetUserChecksum()", "MaxRobReorientSpeed()", "ArgName(n)", "RunMode()", "ExecHandler()",
            "ExecLevel()", "EventType()", "IsStopMoveAct(\\FromMoveTask)", "IsStopStateEvent()", "IsSyncMoveOn()",
            "IsMechUnitActive(STN_1)", "IsCyclicBool(flag)", "IsBrakeCheckActive()", "MotionPlannerNo()",
            "RobName()", "TaskRunMec()", "TaskRunRob()", "TasksInSync()", 'TaskIsActive("a")',
            'TaskIsExecuting("a")', "TaskInSync()", "GetTaskName()", "GetModalPayLoadMode()",
            'GetServiceInfo("a","b")', "GetSysInfo(\\SerialNo)", 'IsSysId("a")', "PFRestart()", "PPMovedInManMode()",
            "ProgMemFree()", "RemainingRetries()", "TestAndSet(flag)", "NonMotionMode()", "GetUASUserName()",
            'IsFile("a")', "IsPers(n)", "IsVar(n)", "Type(n)", "GetMaxNumberOfCyclicBool()",
            "GetNumberOfCyclicBool()", "GetNextCyclicBool(n,s)", "GetNextMechUnit(n,s)", "GetNextSym(s,n)",
        ),
    ),
    (
        "what a file or device holds",
        (
            "ReadBin(file1)", "ReadNum(file1)", "ReadStr(file1)", "ReadStrBin(file1,1)", "ReadDir(dir1,s)",
            'ReadVar("dev",1)', 'FileSize("a")', "FSSize(\"a\"\\Total)", "RawBytesLen(raw1)",
            "SocketGetStatus(sock1)", "SocketPeek(sock1)", "RMQGetSlotName(slot1)", "TextGet(1,1)",
            'TextTabFreeToUse("a")', 'TextTabGet("a")',
        ),
    ),
    (
        "text that is converted",
        (
            "StrToVal(s,n)", "StrToByte(s)", "ByteToStr(b)", 'StrFind(s,1,"a")', 'StrMap(s,"a","b")',
            'StrMemb(s,1,"a")', 'StrOrder(s,"a",STR_UPPER)', 'StrDigCalc(s,OpAdd,"1")', 'StrDigCmp(s,EQ,"1")',
            "DecToHex(s)", "HexToDec(s)", "DnumToStr(n,2)", "BitNeg(b)", "BitAndDnum(n,1)", "BitCheckDnum(n,1)",
            "BitLShDnum(n,1)", "BitNegDnum(n)", "BitOrDnum(n,1)", "BitRShDnum(n,1)", "BitXOrDnum(n,1)",
            "CrossProd(pos1,pos2)", "TriggDataValid(trigg1)",
        ),
    ),
)  # fmt: skip
"""Subject of the request, and a sample call of each: their value is unknown."""
NOT_COMPUTED: Final[tuple[tuple[str, str, tuple[str, ...]], ...]] = ()
"""Reason, remedy and sample calls."""


@dataclass(frozen=True, slots=True)
class RapidForm:
    """Arguments of a motion, in order: points, speed, triggers, zone, tool, and what stands behind."""

    points: int = 1  # Number of robtargets: 2 of a circle
    by_axes: bool = False  # The path between is not a line of the tool tip; its speed is not needed
    triggers: int = 0  # Number of arguments between speed and zone
    behind: int = 0  # Number of arguments behind the tool
    routine: bool = False  # The last one is a routine that runs at the end
    straight: str = "MoveL"  # Instruction that makes a straight motion with the same arguments

    @property
    def plain(self) -> bool:
        """Return whether it has target, speed, zone and tool alone."""
        return self.points == 1 and not self.triggers and not self.behind


FORMS: Final[dict[str, RapidForm]] = {
    "MOVEL": RapidForm(), "MOVEJ": RapidForm(by_axes=True), "MOVEC": RapidForm(2),
    "MOVEABSJ": RapidForm(by_axes=True),
    "MOVEEXTJ": RapidForm(by_axes=True), "MOVELDO": RapidForm(behind=2, straight="MoveLDO"),
    "MOVEJDO": RapidForm(by_axes=True, behind=2), "MOVECDO": RapidForm(2, behind=2, straight="MoveLDO"),
    "MOVELAO": RapidForm(behind=2, straight="MoveLAO"), "MOVEJAO": RapidForm(by_axes=True, behind=2),
    "MOVECAO": RapidForm(2, behind=2, straight="MoveLAO"), "MOVELGO": RapidForm(behind=2, straight="MoveLGO"),
    "MOVEJGO": RapidForm(by_axes=True, behind=2), "MOVECGO": RapidForm(2, behind=2, straight="MoveLGO"),
    "MOVELSYNC": RapidForm(behind=1, routine=True, straight="MoveLSync"),
    "MOVEJSYNC": RapidForm(by_axes=True, behind=1, routine=True),
    "MOVECSYNC": RapidForm(2, behind=1, routine=True, straight="MoveLSync"),
    "TRIGGL": RapidForm(triggers=1, straight="TriggL"), "TRIGGJ": RapidForm(by_axes=True, triggers=1),
    "TRIGGC": RapidForm(2, triggers=1, straight="TriggL"), "TRIGGLIOS": RapidForm(straight="TriggLIOs"),
    "TRIGGJIOS": RapidForm(by_axes=True), "TRIGGABSJ": RapidForm(by_axes=True, triggers=1),
}  # fmt: skip
"""Motions that are evaluated, by name in capitals."""
SETS_MOTION: Final = frozenset(
    (*FORMS, "VELSET", "SPEEDREFRESH", "PDISPSET", "PDISPON", "PDISPOFF", "EOFFSSET", "CALLBYVAR")
)
"""Instructions that move, or change how later ones move."""
OUTPUTS: Final[dict[str, tuple[int | str, ...]]] = {
    "TPREADNUM": (0, "BREAKFLAG"), "TPREADDNUM": (0, "BREAKFLAG"), "TPREADFK": (0, "BREAKFLAG"),
    "UIMSGBOX": ("RESULT", "BREAKFLAG"), "WAITDI": ("TIMEFLAG", "VALUEATTIMEOUT"),
    "WAITDO": ("TIMEFLAG", "VALUEATTIMEOUT"), "WAITAI": ("TIMEFLAG", "VALUEATTIMEOUT"),
    "WAITAO": ("TIMEFLAG", "VALUEATTIMEOUT"), "WAITGI": ("TIMEFLAG", "VALUEATTIMEOUT"),
    "WAITGO": ("TIMEFLAG", "VALUEATTIMEOUT"), "WAITUNTIL": ("TIMEFLAG",), "WAITTESTANDSET": (0,),
    "GETDATAVAL": (1,), "GETSYSDATA": (0,), "READRAWBYTES": (1,), "UNPACKRAWBYTES": (2,), "READBLOCK": (2,),
    "READVARARR": (1,), "READANYBIN": (1,), "READCFGDATA": (2,),
    "SOCKETRECEIVE": ("STR", "RAWDATA", "DATA", "NORECBYTES", "NOOFRECBYTES"),
    "SOCKETRECEIVEFROM": ("STR", "RAWDATA", "DATA", "NORECBYTES", 1, 2), "SOCKETSENDTO": ("NOOFSENTBYTES",),
    "SOCKETACCEPT": ("CLIENTADDRESS",), "READERRDATA": (1, 2, 3, 4, "TITLE"), "GETTRAPDATA": (0,),
    "RMQGETMESSAGE": (1,), "RMQGETMSGDATA": (1,), "RMQGETMSGHEADER": ("HEADER", "SENDERID", "USERDEF"),
    "RMQREADWAIT": (0,), "RMQSENDWAIT": (1, 2, 3, 4), "RMQFINDSLOT": (0,), "BOOKERRNO": (0,), "LOADID": ("WOBJ",),
    "GETJOINTDATA": ("POSITION", "SPEED", "TORQUE", "EXTTORQUE"),
    "COPYRAWBYTES": (2,), "PACKRAWBYTES": (1,), "CLEARRAWBYTES": (0,),
    "MATRIXSOLVE": (2,), "MATRIXSOLVEQR": (2,), "MATRIXSVD": (1, 2, 3),
    "FITCIRCLE": (1, 2, 3, "RMS", "MAXERR", "INDEXWORST"), "FRICIDEVALUATE": (0, 1),
    "CAMGETPARAMETER": ("BOOLVAR", "NUMVAR", "STRVAR"), "CAMGETRESULT": (1,),
    "GETGROUPSIGNALINFO": (1,), "GETTORQUEMARGIN": (0,), "IOBUSSTATE": (1,),
}  # fmt: skip
"""Arguments that an instruction writes into: positions from 0, options in capitals."""
CYCLIC: Final[dict[str, int]] = {"IVARVALUE": 2, "SETUPCYCLICBOOL": 0, "SIGETCYCLIC": 1}
"""Position of the argument that the controller writes into again and again from an instruction on."""
FUNCTION_OUTPUTS: Final[dict[str, tuple[int, ...]]] = {
    "STRTOVAL": (1,), "STRTOBYTE": (), "TESTANDSET": (0,), "GETNEXTSYM": (0, 1), "GETNEXTMECHUNIT": (0, 1),
    "GETNEXTCYCLICBOOL": (0, 1), "READDIR": (1,), "ROBNAME": (),
}  # fmt: skip
"""Arguments that a function writes into."""
ACTS: Final = frozenset((
    "SET", "RESET", "SETDO", "SETAO", "SETGO", "PULSEDO", "INVERTDO", "WAITDI", "WAITDO", "WAITAI", "WAITAO",
    "WAITGI", "WAITGO", "WAITUNTIL", "TPREADFK", "TPREADNUM", "TPREADDNUM", "UIMSGBOX", "CONNECT", "IDELETE",
    "IDISABLE", "IENABLE", "ISIGNALDI", "ISIGNALDO", "ISIGNALAI", "ISIGNALAO", "ISIGNALGI", "ISIGNALGO", "ITIMER",
    "IWATCH", "ISLEEP", "STOPMOVE", "STARTMOVE", "WAITSYNCTASK", "SOCKETSEND", "SOCKETRECEIVE",
))  # fmt: skip
"""Instructions that act on the cell, or wait for it."""
_EVALUATED: Final = (
    ("MODULE", "head of a module", "MODULE m"), ("ENDMODULE", "end of a module", "ENDMODULE"),
    ("PROC", "routine, executed where it is called", "PROC cut(num depth)"), ("ENDPROC", "its end", "ENDPROC"),
    ("FUNC", "routine with a value", "FUNC num half(num x)"), ("ENDFUNC", "its end", "ENDFUNC"),
    ("TRAP", "interrupt: what it assigns is unknown from CONNECT on", "TRAP stopped"), ("ENDTRAP", "end", "ENDTRAP"),
    ("RECORD", "data type", "RECORD pair"), ("ENDRECORD", "its end", "ENDRECORD"),
    ("ALIAS", "other name of a data type", "ALIAS num level;"),
    ("CONST", "data", "CONST num a:=1;"), ("VAR", "data", "VAR num a:=1;"),
    ("PERS", "data that keeps its value: what the program itself changes begins unknown", "PERS num a:=1;"),
    (":=", "assignment, to components and elements too", "a:=2;"),
    ("IF", "branch by a condition; also the compact form", "IF a=2 cut 1;"), ("ELSEIF", "branch", "ELSEIF a=3 THEN"),
    ("ELSE", "branch", "ELSE"), ("ENDIF", "end", "ENDIF"), ("FOR", "counted loop", "FOR i FROM 1 TO 3 DO"),
    ("ENDFOR", "end", "ENDFOR"), ("WHILE", "loop by a condition", "WHILE a<3 DO"), ("ENDWHILE", "end", "ENDWHILE"),
    ("TEST", "branch by a value", "TEST a"), ("CASE", "branch", "CASE 1,2:"), ("DEFAULT", "branch", "DEFAULT:"),
    ("ENDTEST", "end", "ENDTEST"), ("GOTO", "jump to a label", "GOTO again;"),
    ("RETURN", "end of a routine, with the value of a function", "RETURN a;"),
    ("EXIT", "end of the program", "EXIT;"),
    ("ExitCycle", "end of the cycle: what comes behind is the next one", "ExitCycle;"),
    ("CallByVar", "routine by a number", 'CallByVar "cut",1;'), ("ERROR", "handler: errors are not evaluated", "ERROR"),
    ("UNDO", "handler: errors are not evaluated", "UNDO"), ("BACKWARD", "handler of steps back", "BACKWARD"),
    ("Stop", "stop; the path goes on from there", "Stop;"),
    ("MoveL", "straight motion", "MoveL p10,v20,fine,tool0;"), ("MoveC", "circle", "MoveC p10,p20,v20,fine,tool0;"),
    ("MoveJ", "rapid; its speed is not needed", "MoveJ p10,vmax,fine,tool0;"),
    ("MoveAbsJ", "place by axes: from the robot of the cell, else unknown", "MoveAbsJ j10,v100,fine,tool0;"),
    ("MoveExtJ", "external axes must stay where they stand", "MoveExtJ j10,v100,fine;"),
    ("MoveLDO", "MoveL; carries its output", "MoveLDO p10,v20,z1,tool0,do1,1;"),
    ("MoveJDO", "MoveJ; carries its output", "MoveJDO p10,v20,z1,tool0,do1,1;"),
    ("MoveCDO", "MoveC; carries its output", "MoveCDO p10,p20,v20,z1,tool0,do1,1;"),
    ("MoveLAO", "MoveL; carries its output", "MoveLAO p10,v20,z1,tool0,ao1,1;"),
    ("MoveJAO", "MoveJ; carries its output", "MoveJAO p10,v20,z1,tool0,ao1,1;"),
    ("MoveCAO", "MoveC; carries its output", "MoveCAO p10,p20,v20,z1,tool0,ao1,1;"),
    ("MoveLGO", "MoveL; carries its output", "MoveLGO p10,v20,z1,tool0,go1,1;"),
    ("MoveJGO", "MoveJ; carries its output", "MoveJGO p10,v20,z1,tool0,go1,1;"),
    ("MoveCGO", "MoveC; carries its output", "MoveCGO p10,p20,v20,z1,tool0,go1,1;"),
    ("MoveLSync", "MoveL; a routine that moves is refused", 'MoveLSync p10,v20,z1,tool0,"beep";'),
    ("MoveJSync", "MoveJ; a routine that moves is refused", 'MoveJSync p10,v20,z1,tool0,"beep";'),
    ("MoveCSync", "MoveC; a routine that moves is refused", 'MoveCSync p10,p20,v20,z1,tool0,"beep";'),
    ("TriggL", "MoveL; carries its triggers", "TriggL p10,v20,trigg1,z1,tool0;"),
    ("TriggJ", "MoveJ; carries its triggers", "TriggJ p10,v20,trigg1,z1,tool0;"),
    ("TriggC", "MoveC; carries its triggers", "TriggC p10,p20,v20,trigg1,z1,tool0;"),
    ("TriggLIOs", "MoveL; carries its triggers", "TriggLIOs p10,v20\\TriggData1:=trigg1,z1,tool0;"),
    ("TriggJIOs", "MoveJ; carries its triggers", "TriggJIOs p10,v20\\TriggData1:=trigg1,z1,tool0;"),
    ("TriggAbsJ", "MoveAbsJ; carries its triggers", "TriggAbsJ j10,v20,trigg1,z1,tool0;"),
    ("WaitTime", "dwell", "WaitTime 0.5;"), ("VelSet", "override and largest speed", "VelSet 50,800;"),
    ("SpeedRefresh", "100 alone; others act in the middle of a motion", "SpeedRefresh 100;"),
    ("PDispSet", "displacement of the targets behind it", "PDispSet [[0,0,1],[1,0,0,0]];"),
    ("PDispOn", "displacement between two targets", "PDispOn\\ExeP:=p20,p10,tool0;"),
    ("PDispOff", "end of the displacement", "PDispOff;"), ("EOffsSet", "offsets of 0 alone", "EOffsSet [0,0,0,0,0,0];"),
    ("Incr", "adds 1", "Incr n;"), ("Decr", "takes 1", "Decr n;"), ("Add", "adds a number", "Add n,2;"),
    ("Clear", "sets 0", "Clear n;"), ("BitSet", "sets a bit", "BitSet b,1;"),
    ("BitClear", "clears a bit", "BitClear b,1;"),
    ("CONNECT", "what the interrupt assigns is unknown behind it", "CONNECT i1 WITH stopped;"),
)  # fmt: skip


def _rows() -> Iterator[Statement]:
    for word, reason, sample in _EVALUATED:
        yield Statement(word, Treatment.EVALUATED, reason, samples=(sample,))
    for reason, samples in NEUTRAL_GROUPS:
        for sample in samples:
            yield Statement(_word(sample), Treatment.NEUTRAL, reason, samples=(sample,))
    for reason, remedy, samples in REFUSED_GROUPS:
        for sample in samples:
            yield Statement(_word(sample), Treatment.REFUSED, reason, remedy, (sample,))
    for calls in COMPUTED:
        yield Statement(_word(calls), Treatment.EVALUATED, "function: computed", samples=(f"any:={calls};",))
    for reason, samples in REQUESTS:
        for calls in samples:
            yield Statement(
                _word(calls),
                Treatment.EVALUATED,
                f"function: its value is unknown, {reason}",
                samples=(f"any:={calls};",),
            )
    for reason, remedy, samples in NOT_COMPUTED:
        for calls in samples:
            yield Statement(_word(calls), Treatment.REFUSED, reason, remedy, (f"any:={calls};",))


def _word(sample: str) -> str:
    """Return the first word of a sample."""
    end = next((i for i, character in enumerate(sample) if not character.isalnum() and character != "_"), len(sample))
    return sample[:end]


TABLE: Final = StatementTable(
    "rapid", "ABB RAPID: instructions, functions and data types (3HAC050917, RobotWare 6)", tuple(_rows())
)
