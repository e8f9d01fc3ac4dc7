/PROG  GROOVE2
/ATTR
OWNER           = MNEDITOR;
COMMENT         = "form of a post";
PROG_SIZE       = 0;
CREATE          = DATE 31-12-14  TIME 12:00:00;
MODIFIED        = DATE 31-12-14  TIME 12:00:00;
FILE_NAME       = GROOVE2;
VERSION         = 0;
LINE_COUNT      = 9;
MEMORY_SIZE     = 0;
PROTECT         = READ_WRITE;
TCD:  STACK_SIZE        = 0,
      TASK_PRIORITY     = 50,
      TIME_SLICE        = 0,
      BUSY_LAMP_OFF     = 0,
      ABORT_REQUEST     = 0,
      PAUSE_REQUEST     = 0;
DEFAULT_GROUP   = 1,*,*,*,*,*,*;
CONTROL_CODE    = 00000000 00000000;
/MN
   1:  !in the form of a post, by hand ;
   2:  UFRAME_NUM=1 ;
   3:  UTOOL_NUM=1 ;
   4:J P[1] 20% FINE ;
   5:L P[2] 50mm/sec CNT5 ;
   6:L P[3] 25mm/sec CNT1 ;
   7:C P[4]
    :  P[5] 25mm/sec CNT1 ;
   8:L P[6] 25mm/sec FINE ;
   9:L P[7] 250mm/sec FINE ;
/POS
P[1]{
   GP1:
    UF : 1, UT : 1,     CONFIG : 'N U T, 0, 0, 0',
    X =   -12.000  mm,    Y =    15.000  mm,    Z =    60.000  mm,
    W =   180.000 deg,    P =     0.000 deg,    R =   180.000 deg
};
P[2]{
   GP1:
    UF : 1, UT : 1,     CONFIG : 'N U T, 0, 0, 0',
    X =   -12.000  mm,    Y =    15.000  mm,    Z =    34.000  mm,
    W =   180.000 deg,    P =     0.000 deg,    R =   180.000 deg
};
P[3]{
   GP1:
    UF : 1, UT : 1,     CONFIG : 'N U T, 0, 0, 0',
    X =    40.000  mm,    Y =    15.000  mm,    Z =    34.000  mm,
    W =   180.000 deg,    P =     0.000 deg,    R =   180.000 deg
};
P[4]{
   GP1:
    UF : 1, UT : 1,     CONFIG : 'N U T, 0, 0, 0',
    X =    43.536  mm,    Y =    16.464  mm,    Z =    34.000  mm,
    W =   180.000 deg,    P =     0.000 deg,    R =   180.000 deg
};
P[5]{
   GP1:
    UF : 1, UT : 1,     CONFIG : 'N U T, 0, 0, 0',
    X =    45.000  mm,    Y =    20.000  mm,    Z =    34.000  mm,
    W =   180.000 deg,    P =     0.000 deg,    R =   180.000 deg
};
P[6]{
   GP1:
    UF : 1, UT : 1,     CONFIG : 'N U T, 0, 0, 0',
    X =    45.000  mm,    Y =    72.000  mm,    Z =    34.000  mm,
    W =   180.000 deg,    P =     0.000 deg,    R =   180.000 deg
};
P[7]{
   GP1:
    UF : 1, UT : 1,     CONFIG : 'N U T, 0, 0, 0',
    X =    45.000  mm,    Y =    72.000  mm,    Z =    60.000  mm,
    W =   180.000 deg,    P =     0.000 deg,    R =   180.000 deg
};
/END
