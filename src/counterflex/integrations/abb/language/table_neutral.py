"""Instructions of RAPID that leave the path as it is."""

from __future__ import annotations

from typing import Final

NEUTRAL_GROUPS: Final[tuple[tuple[str, tuple[str, ...]], ...]] = (
    (
        "sets an output",
        (
            "Set do1;", "Reset do1;", "SetDO do1,1;", "SetAO ao1,2.5;", "SetGO go1,3;", "PulseDO do1;",
            "InvertDO do1;", "AliasIO do1,do2;", "AliasIOReset do2;", 'IOEnable "board",1;', 'IODisable "board",1;',
            'IOBusStart "net";', "SetSysData tool0;",
        ),
    ),
    (
        "waits; the tool stays where it is, for a time that the program does not state",
        (
            "WaitDI di1,1;", "WaitDO do1,1;", "WaitAI ai1\\GT,5;", "WaitAO ao1\\GT,5;", "WaitGI gi1,5;",
            "WaitGO go1,5;", "WaitUntil di1=1;", "WaitRob\\ZeroSpeed;", "WaitTestAndSet flag;",
            "WaitSyncTask sync1,tasks;", "WaitLoad session;", 'IOBusState "net",state;',
        ),
    ),
    (
        "a message, or a question whose answer is unknown behind it",
        (
            'TPWrite "text";', "TPErase;", "TPShow TP_LATEST;", 'TPReadNum n,"depth";', 'TPReadDnum n,"depth";',
            'TPReadFK n,"go on?","","","","no","yes";', 'UIMsgBox "text";', 'UIMsgWrite "text";', "UIMsgWriteAbort;",
            'UIShow "a.dll","b";', 'ErrWrite "title","text";', 'ErrLog 5001,err1,"a","b","c","d";',
            'ErrRaise "name",1,"a","b","c","d","e";', 'TextTabInstall "HOME:/a.eng";',
        ),
    ),
    (
        "measures time",
        (
            "ClkReset clock1;", "ClkStart clock1;", "ClkStop clock1;",
        ),
    ),
    (
        "configuration of the axes: the path of the tool stays",
        (
            "ConfL\\Off;", "ConfJ\\Off;",
        ),
    ),
    (
        "behaviour near a singularity: the path of the tip stays, and preflight names singular places",
        (
            "SingArea\\Wrist;",
        ),
    ),
    (
        "acceleration, or a limit while an input asks for it: the path stays",
        (
            "AccSet 50,100;", "WorldAccLim\\On:=3;", "PathAccLim TRUE\\AccMax:=4,FALSE;", "SpeedLimAxis STN_1,1,10;",
            "SpeedLimCheckPoint 200;", "CornerPathWarning FALSE;", "PathLengthReset;", "PathLengthStart;",
            "PathLengthStop;",
        ),
    ),
    (
        ("orientation on circles whose ends hold the tool alike stays, and other circles are "
     "interpolated between them"),
        (
            "CirPathMode\\PathFrame;",
        ),
    ),
    (
        "load, tuning and supervision of the axes: the path stays",
        (
            "GripLoad load0;", "MechUnitLoad STN_1,1,load0;", "PathResol 150;", "MotionSup\\Off;",
            "MotionProcessModeSet OPTIMAL_CYCLE_TIME_MODE;", "TuneServo ROB_1,1,100;", "TuneReset;", "SoftDeact;",
            "DitherAct ROB_1,1,0.5;", "DitherDeact;", "FricIdInit;", "FricIdEvaluate;",
            "FricIdSetFricLevels levels;", "SetupCyclicBool flag,di1=1;", "RemoveCyclicBool flag;",
            "RemoveAllCyclicBool;", "SafetyControllerSyncRequest;",
        ),
    ),
    (
        "switches an external axis on or off: it stays where it stands",
        (
            "ActUnit STN_1;", "DeactUnit STN_1;", "BrakeCheck;", "CyclicBrakeCheck;",
        ),
    ),
    (
        "stops the robot and lets it go on along the same path",
        (
            "StopMove;", "StartMove;", "StopMoveReset;", "StartMoveRetry;", "Break;", "StorePath;", "RestoPath;",
            "SystemStopAction\\Stop;", "ProcerrRecovery\\SYNC_ORG_MOVE_INST;", "SkipWarn;",
        ),
    ),
    (
        "interrupts: what their routines may change is taken at CONNECT",
        (
            "IDelete i1;", "IDisable;", "IEnable;", "ISleep i1;", "IWatch i1;", "ISignalDI di1,1,i1;",
            "ISignalDO do1,1,i1;", "ISignalAI ai1,AIO_BETWEEN,1,2,0,i1;", "ISignalAO ao1,AIO_BETWEEN,1,2,0,i1;",
            "ISignalGI gi1,i1;", "ISignalGO go1,i1;", "ITimer 60,i1;", "IPers count,i1;",
            "IError COMMON_ERR,TYPE_ALL,i1;", 'IVarValue "dev",1,count,i1;', "IRMQMessage text,i1;",
            "GetTrapData data;", "ReadErrData data,domain,id,type;", "BookErrNo err1;", "ActEventBuffer;",
            "DeactEventBuffer;", "TryInt n;",
        ),
    ),
    (
        "defines triggers, which act on outputs",
        (
            "TriggIO trigg1,0.2\\DOp:=do1,1;", "TriggEquip trigg1,10,0.1\\DOp:=do1,1;", "TriggInt trigg1,5,i1;",
            "TriggCheckIO trigg1,5,di1,EQ,1,i1;", "TriggRampAO trigg1,0,0.1,ao1,8,12;",
            "TriggSpeed trigg1,0,0.05,ao1,0.8;", "TriggDataReset trigg1;", "TriggDataCopy trigg1,trigg2;",
            "TriggStopProc restart1,do1;",
        ),
    ),
    (
        "files, devices and other tasks: data that they read is unknown behind them",
        (
            'Open "HOME:",file1;', "Close file1;", 'Write file1,"text";', "WriteBin file1,buffer,5;",
            'WriteStrBin file1,"a";', "WriteAnyBin file1,count;", "ReadAnyBin file1,count;", "Rewind file1;",
            "ClearIOBuff com1;", 'CopyFile "a","b";', 'RenameFile "a","b";', 'RemoveFile "a";', 'MakeDir "a";',
            'RemoveDir "a";', 'OpenDir dir1,"HOME:";', "CloseDir dir1;", "CopyRawBytes raw1,1,raw2,1;",
            "ClearRawBytes raw1;", "PackRawBytes count,raw1,1\\IntX:=DINT;",
            "UnpackRawBytes raw1,1,count\\IntX:=DINT;", 'PackDNHeader "0E","6",raw1;', "ReadRawBytes file1,raw1;",
            "WriteRawBytes file1,raw1;", 'ReadBlock "dev",1,count;', 'WriteBlock "dev",1,count;',
            'WriteVar "dev",1,count;', 'WriteVarArr "dev",list1;', 'ReadVarArr "dev",list1,n;', 'SenDevice "sen1:";',
            "SiConnect sensor1;", "SiClose sensor1;", "SiGetCyclic sensor1,data1,10;",
            "SiSetCyclic sensor1,data1,10;", "GetGroupSignalInfo go1,info1;", "GetTorqueMargin list1;",
            "MatrixSolve list1,list2,list3;", "MatrixSolveQR list1,list2,list3;",
            "MatrixSVD list1,list2,list3,list4;", "FitCircle list1,p1,radius,normal;", "CamFlush cam1;",
            "CamGetParameter cam1,\"a\"\\NumVar:=n;", "CamGetResult cam1,target1;", 'CamLoadJob cam1,"a.job";',
            "CamReqImage cam1;", "CamSetExposure cam1\\ExposureTime:=5;", "CamSetParameter cam1,\"a\"\\NumVal:=1;",
            "CamSetProgramMode cam1;", "CamSetRunMode cam1;", 'CamStartLoadJob cam1,"a.job";',
            "CamWaitLoadJob cam1;", "AliasCamera cam1,cam2;", "SocketCreate sock1;",
            'SocketConnect sock1,"192.168.0.1",1025;', 'SocketBind sock1,"192.168.0.1",1025;', "SocketListen sock1;",
            "SocketAccept sock1,sock2;", "SocketSend sock1\\Str:=\"a\";", "SocketReceive sock1\\Str:=text;",
            "SocketClose sock1;", 'SocketSendTo sock1,"a",1;', 'SocketReceiveFrom sock1,"a",1;',
            'RMQFindSlot slot1,"RMQ_T";', "RMQSendMessage slot1,text;", "RMQSendWait slot1,text,i1,answer;",
            "RMQReadWait message;", "RMQGetMessage message;", "RMQGetMsgData message,text;",
            "RMQGetMsgHeader message;", "RMQEmptyQueue;", 'SpyStart "HOME:/spy.log";', "SpyStop;", "SCWrite count;",
            "SaveCfgData \"a\"\\File:=\"b\",ALL_DOMAINS;", 'WriteCfgData "/MOC","attr",count;',
            'ReadCfgData "/MOC","attr",count;', 'SetDataSearch "num";', 'GetDataVal "name",count;',
            "GetSysData tOther;", "GetJointData 1;", "ResetPPMoved;", "ResetRetryCount;", "ResetAxisDistance 1;",
            "ResetAxisMoveTime 1;", "ResetTorqueMargin;", "TestSignDefine 1,speed,ROB_1,1,0;", "TestSignReset;",
        ),
    ),
    (
        "modules in memory: a file that lies in the folder belongs to the program",
        (
            "Load\\Dynamic,\"HOME:/a.mod\";", 'UnLoad "HOME:/a.mod";', "StartLoad\\Dynamic,\"HOME:/a.mod\",session;",
            "CancelLoad session;", 'EraseModule "a";', 'Save "a";', "CheckProgRef;",
        ),
    ),
    (
        "zones that stop the robot at their border; the path stays",
        (
            "WZBoxDef\\Inside,volume,[0,0,0],[1,1,1];", "WZCylDef\\Inside,volume,[0,0,0],100,100;",
            "WZSphDef\\Inside,volume,[0,0,0],100;", "WZLimSup\\Temp,zone1,volume;",
            "WZLimJointDef\\Inside,volume,low,high;", "WZHomeJointDef\\Inside,volume,home,delta;",
            "WZDOSet\\Temp,zone1\\Inside,volume,do1,1;", "WZEnable zone1;", "WZDisable zone1;", "WZFree zone1;",
        ),
    ),
)  # fmt: skip
"""Reason, and a complete sample of each; its first word is the instruction."""
