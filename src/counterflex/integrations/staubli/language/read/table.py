"""Statements, instructions and functions of VAL3: what the reader does with each."""

from __future__ import annotations

from typing import Final

from counterflex.programs.statement_table import Statement, StatementTable, Treatment

_E, _N, _R = Treatment.EVALUATED, Treatment.NEUTRAL, Treatment.REFUSED
_POST: Final = "Post the path without it"


def _rows(treatment: Treatment, reason: str, samples: str, remedy: str = "") -> tuple[Statement, ...]:
    """Rows of several statements, one sample each, of which the word before the bracket is the key."""
    out = []
    for sample in samples.split(" ; "):
        head = sample.strip().partition("(")[0].split()[0]
        word = head.rpartition("=")[2].rpartition(":")[2]
        out.append(Statement(word, treatment, reason, remedy, (sample.strip(),)))
    return tuple(out)


_MOTIONS: Final = (
    *_rows(_E, "motion to a point; of movej to a joint too", "movej(p[0],tMill,mRun) ; movel(p[0],tMill,mRun)"),
    *_rows(_E, "circle through a point", "movec(p[0],p[1],tMill,mRun)"),
    *_rows(_E, "the motion before it stops at its end", "waitEndMove() ; open(tMill) ; close(tMill)"),
    *_rows(_E, "dwell, where the robot is at rest", "delay(0.5)"),
    *_rows(_E, "stop until a key is pressed", "get()"),
    *_rows(_E, "cancels motions: refused where one is not finished", "resetMotion()"),
    *_rows(_R, "the path is changed while it runs", "alter(tShift) ; alterBegin(fPart,tShift) ; alterEnd() ; "
           "alterMovej(p[0],tMill,mRun) ; alterMovel(p[0],tMill,mRun) ; alterMovec(p[0],p[1],tMill,mRun) ; "
           "alterStopTime(0.1)", _POST),
    *_rows(_R, "the robot yields to forces", "movejf(j,tMill,mRun) ; movelf(p[0],tMill,mRun) ; "
           "movef(p[0],tMill,mRun)", _POST),
    *_rows(_R, "motions are held back until restartMove", "stopMove()", _POST),
)  # fmt: skip
_GEOMETRY: Final = (
    *_rows(_E, "a frame from three points", "setFrame(p[0],p[1],p[2],fPart)"),
    *_rows(_E, "another father of a point, frame or tool", "link(p[0],fPart)"),
    *_rows(_E, "computed from its arguments", "pA=appro(p[0],{0,0,1,0,0,0}) ; pA=compose(p[0],fPart,{0,0,1,0,0,0}) ; "
           "tA=position(p[0],fPart) ; nA=distance(p[0],p[1]) ; tA=interpolateL(tA,tA,0.5) ; nA=abs(1) ; nA=sqrt(1) ; "
           "nA=exp(1) ; nA=ln(1) ; nA=log(1) ; nA=sin(1) ; nA=cos(1) ; nA=tan(1) ; nA=asin(1) ; nA=acos(1) ; "
           "nA=atan(1) ; nA=power(2,3) ; nA=min(1,2) ; nA=max(1,2) ; nA=trunc(1) ; nA=roundUp(1) ; nA=roundDown(1) ; "
           "nA=round(1) ; nA=limit(1,0,2) ; nA=sel(true,1,2) ; nA=size(p)"),
)  # fmt: skip
_SPEED: Final = (
    *_rows(_E, "factor of all speeds: 100 alone, because another takes effect in some operating modes only",
           "setMonitorSpeed(100)"),
)  # fmt: skip
_FLOW: Final = (
    *_rows(_E, "condition", "if (nA==1) ; elseIf (nA==2) ; else ; endIf"),
    *_rows(_E, "branches by a value", "switch nA ; case 1 ; default ; break ; endSwitch"),
    *_rows(_E, "loop", "for nA=0 to 2 step 1 ; endFor ; while (nA<2) ; endWhile ; do ; until (nA>2)"),
    *_rows(_E, "a program of the application or of a library", "call part(1)"),
    *_rows(_E, "end of the program", "return"),
    *_rows(_E, "a program that neither moves nor sets what motions depend on, beside this one",
           'taskCreate "watch",10,watch() ; taskCreateSync "watch",10,watch()'),
    *_rows(_E, "the library that an alias stands for", 'nA=lib:libLoad("./other")'),
)  # fmt: skip
_CELL: Final = (
    *_rows(_N, "shows or records something", 'userPage() ; cls() ; gotoxy(0,0) ; setTextMode(1) ; put("a") ; '
           'putln("a") ; title("a") ; popUpMsg("a") ; logMsg("a") ; setProfile("a","b") ; setLanguage("english")'),
    *_rows(_N, "power, brakes and messages of the robot at rest", "enablePower()"),
    *_rows(_N, "numbers and connects motions, changes none", "setMoveId(1) ; autoConnectMove(true) ; restartMove()"),
    *_rows(_N, "order of tasks", 'wait(true) ; bA=watch(true,1) ; taskSuspend("a") ; taskResume("a",0) ; '
           'taskKill("a") ; bA=setMutex(bM)'),
    *_rows(_N, "inputs and outputs", "dioLink(d,io:d) ; aioLink(a,io:a) ; sioLink(s,io:s) ; nA=dioSet(d,1) ; "
           'aioSet(a,1) ; nA=sioSet(s,"a") ; clearBuffer(s) ; nA=sioCtrl(s,"port",1) ; setDout(d,true)'),
    *_rows(_N, "files of libraries", 'nA=libSave() ; nA=libDelete("a")'),
    *_rows(_N, "watches a place", "setLatch(d)"),
    *_rows(_R, "motions end where they are", "disablePower()", _POST),
    *_rows(_R, "the turns of the axes change", "resetTurn(j)", _POST),
    *_rows(_R, "the list of variables changes while the program runs",
           "resize(p,1,2) ; append(p) ; insert(p,1) ; delete(p,1)", "Write the elements into the data file"),
)  # fmt: skip
_STATE: Final = _rows(
    _N, "its value is not known; a statement that needs it is refused",
    'jA=herej() ; pA=here(tMill,fPart) ; bA=isInRange(jA) ; jA=getLatch(jA) ; bA=pointToJoint(tMill,jA,p[0],jA) ; '
    "pA=jointToPoint(tMill,fPart,jA) ; cA=config(jA) ; tA=interpolateC(tA,tA,tA,0.5) ; tA=align(tA,tA) ; "
    "nA=getMonitorSpeed() ; nA=getSpeed(tMill) ; bA=isEmpty() ; bA=isSettled() ; bA=isPowered() ; bA=isCalibrated() ; "
    'nA=workingMode() ; nA=esStatus() ; nA=safetyFault(sA) ; sA=getVersion("a") ; nA=ioBusStatus(sA) ; '
    "nA=getPositionErr(jA) ; nA=getJointForce(nA) ; bA=isCompliant() ; nA=getMoveId() ; nA=getKey() ; "
    'bA=isKeyPressed(1) ; nA=getDisplayLen("a") ; sA=getProfile() ; sA=getLanguage() ; sA=getDate("a") ; nA=clock() ; '
    'nA=taskStatus("a") ; sA=help("a") ; nA=dioGet(d) ; nA=aioGet(a) ; nA=sioGet(s,nA) ; nA=ioStatus(d) ; '
    'sA=libPath() ; bA=libList("a",sA) ; bA=libExist("a") ; bA=isDefined(nA) ; sA=getName(nA) ; nA=random(1) ; '
    "sA=chr(65) ; nA=asc(sA,0) ; sA=left(sA,1) ; sA=right(sA,1) ; sA=mid(sA,1,0) ; sA=replace(sA,sA,1,0) ; "
    'nA=find(sA,"a") ; nA=len(sA) ; sA=toString("",1) ; sA=toNum(sA,nA,bA) ; sA=codePage(1) ; nA=toBinary(nA,1,"a",nA) '
    '; nA=fromBinary(nA,1,"a",nA) ; nA=bAnd(1,1) ; nA=bOr(1,1) ; nA=bXor(1,1) ; nA=bNot(1) ; sA=first(sA) ; '
    "sA=next(sA) ; sA=prev(sA) ; sA=last(sA) ; nA=typeof(nA)",
)  # fmt: skip
_ASSIGNMENT: Final = (
    Statement("=", _E, "variable, element or component", "", ("nA=nA+1",)),
    Statement("//", _N, "comment", "", ("// comment",)),
)
TABLE: Final = StatementTable(
    "val3",
    "Staubli VAL3 Reference manual, versions 5.3 to 7.3, with the options alter and compliance",
    (*_ASSIGNMENT, *_MOTIONS, *_GEOMETRY, *_SPEED, *_FLOW, *_CELL, *_STATE),
)
ACTING: Final = frozenset(
    ("open", "close", "wait", "watch", "aioSet", "dioSet", "sioSet", "setDout", "taskSuspend", "taskResume", "taskKill",
     "taskCreate", "taskCreateSync")
)  # fmt: skip
"""Instructions that act on the cell, or wait for it."""
EFFECTS: Final = frozenset(
    row.word for row in (*_MOTIONS, *_SPEED) if row.word != "get"
) | {"setFrame", "link", "libLoad"}  # fmt: skip
"""Functions that do something beside giving a value: they stand alone, or behind ``name=``."""
