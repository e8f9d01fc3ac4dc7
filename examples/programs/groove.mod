%%%
  VERSION:1
  LANGUAGE:ENGLISH
%%%

MODULE Groove
  ! One groove, 6 mm deep, through a blank of 60 x 60 x 40 mm: groove.ngc in RAPID
  PERS tooldata tMill:=[TRUE,[[240,0,150],[0.70710678,0,0.70710678,0]],
    [86,[104.6,0,137.2],[1,0,0,0],0,0,0]];
  PERS wobjdata wobjPart:=[FALSE,TRUE,"",[[1350,-30,1000],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  CONST speeddata vMill:=[25,100,5000,1000];
  CONST num hAbove:=18;
  CONST jointtarget jRest:=[[0,-20,30,0,60,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget pBefore:=[[-12,15,42],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST robtarget pIn:=[[-12,15,34],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];

  PROC main()
    ConfJ \Off;
    ConfL \Off;
    TPWrite "change to tool T1, then press start";
    Stop;
    MoveAbsJ jRest,v100,fine,tMill\WObj:=wobjPart;
    TPWrite "start the spindle, 13000 rpm, then press start";
    Stop;
    Approach;
    CutGroove;
    TPWrite "stop the spindle, then press start";
    Stop;
    MoveAbsJ jRest,v100,fine,tMill\WObj:=wobjPart;
  ENDPROC

  PROC Approach()
    MoveJ Offs(pBefore,0,0,hAbove),v500,z1,tMill\WObj:=wobjPart;
    MoveL pBefore,v300\V:=250,z1,tMill\WObj:=wobjPart;
  ENDPROC

  LOCAL PROC CutGroove()
    MoveL pIn,v50,z0,tMill\WObj:=wobjPart;
    SetDO doChips,1; ! chip conveyor
    MoveL [[72,15,34],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],vMill,fine,tMill\WObj:=wobjPart; ! the groove
    MoveL Offs(pIn,84,0,26),v300\V:=250,z1,tMill\WObj:=wobjPart;
  ENDPROC
ENDMODULE
