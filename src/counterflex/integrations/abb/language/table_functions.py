"""Functions of RAPID: computed, unknown because they ask the controller, or refused."""

from __future__ import annotations

from typing import Final

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
