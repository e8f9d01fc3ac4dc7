"""Instructions of RAPID that move the robot, or change where it goes, in ways that a program does not tell."""

from __future__ import annotations

from typing import Final

_PATH: Final = "Post the path with MoveL and MoveC, process signals as statements of their own"
_WITHOUT: Final = "Post the path without it"
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
