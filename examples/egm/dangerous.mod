MODULE Dangerous
  ! How EGM is often shown in examples, and why not to mill so: counterflex egm check says what is wrong.
  VAR egmident egmID1;
  CONST pose poseZero:=[[0,0,0],[1,0,0,0]];
  CONST egm_minmax window:=[-1,1];
  CONST robtarget pStart:=[[0,0,60],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PERS tooldata tSpindle:=[TRUE,[[240,0,150],[0.70710678,0,0.70710678,0]],[90,[105,0,138],[1,0,0,0],0,0,0]];
  PERS wobjdata wPart:=[FALSE,TRUE,"",[[1350,-30,1000],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  PROC main()
    MoveJ pStart,v100,z5,tSpindle\WObj:=wPart;
    EGMGetId egmID1;
    EGMSetupUC ROB_1,egmID1,"default","UCdevice"\Pose;
    EGMActPose egmID1\Tool:=tSpindle\WObj:=wPart,poseZero,EGM_FRAME_WOBJ,poseZero,EGM_FRAME_WOBJ
      \x:=window\y:=window\z:=window\rx:=window\ry:=window\rz:=window;
    EGMRunPose egmID1,EGM_STOP_RAMP_DOWN\NoWaitCond\x\y\z\PosCorrGain:=0;
  ENDPROC
ENDMODULE
