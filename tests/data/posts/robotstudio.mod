MODULE Module1
    CONST robtarget Target_10:=[[-12,15,60],[0,0,1,0],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
    CONST robtarget Target_20:=[[-12,15,34],[0,0,1,0],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
    CONST robtarget Target_30:=[[40,15,34],[0,0,1,0],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
    CONST robtarget Target_40:=[[43.535533906,16.464466094,34],[0,0,1,0],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
    CONST robtarget Target_50:=[[45,20,34],[0,0,1,0],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
    CONST robtarget Target_60:=[[45,72,34],[0,0,1,0],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
    TASK PERS tooldata tMill:=[TRUE,[[240,0,150],[0.707106781,0,0.707106781,0]],[86,[104.6,0,137.2],[1,0,0,0],0,0,0]];
    TASK PERS wobjdata wobjPart:=[FALSE,TRUE,"",[[1350,-30,1000],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
!***********************************************************
    !
    ! Module:  Module1
    !
    ! Description:
    !   <Insert description here>
    !
!***********************************************************
    PROC main()
        Path_10;
    ENDPROC
    PROC Path_10()
        AccSet 50,100;
        ConfL\Off;
        SingArea\Wrist;
        MoveJ Target_10,v200,fine,tMill\WObj:=wobjPart;
        MoveL Target_20,v50,fine,tMill\WObj:=wobjPart;
        MoveL Target_30,[25,100,5000,1000],z1,tMill\WObj:=wobjPart;
        MoveC Target_40,Target_50,v20,z1,tMill\WObj:=wobjPart;
        MoveL Target_60,v20,fine,tMill\WObj:=wobjPart;
        MoveL Offs(Target_60,0,0,26),v200,fine,tMill\WObj:=wobjPart;
    ENDPROC
ENDMODULE
