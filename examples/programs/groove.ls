/PROG  GROOVE
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "One groove";
PROG_SIZE	= 1024;
LINE_COUNT	= 18;
PROTECT		= READ_WRITE;
TCD:  STACK_SIZE	= 0,
      TASK_PRIORITY	= 50,
      TIME_SLICE	= 0,
      BUSY_LAMP_OFF	= 0,
      ABORT_REQUEST	= 0,
      PAUSE_REQUEST	= 0;
DEFAULT_GROUP	= 1,*,*,*,*;
CONTROL_CODE	= 00000000 00000000;
/APPL
/MN
   1:  !groove.ngc in FANUC TP ;
   2:  !change to tool T1 ;
   3:  PAUSE ;
   4:  UFRAME_NUM=1 ;
   5:  UTOOL_NUM=1 ;
   6:  PAYLOAD[1] ;
   7:J P[1:"rest"] 10% FINE    ;
   8:  !start spindle, 13000 rpm ;
   9:  PAUSE ;
  10:J P[2:"above"] 20% FINE    ;
  11:L P[3] 250mm/sec CNT10    ;
  12:L P[4] 50mm/sec CNT0    ;
  13:  DO[7:chips]=ON ;
  14:L P[5] 150cm/min FINE ACC80    ;
  15:L P[6] 250mm/sec FINE    ;
  16:  !stop the spindle ;
  17:  PAUSE ;
  18:J P[1:"rest"] 10% FINE    ;
/POS
P[1:"rest"]{
   GP1:
	UF : 1, UT : 1,	
	J1=     0.000 deg,	J2=   -20.000 deg,	J3=    30.000 deg,
	J4=     0.000 deg,	J5=    60.000 deg,	J6=     0.000 deg
};
P[2:"above"]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   -12.000  mm,	Y =    15.000  mm,	Z =    60.000  mm,
	W =   180.000 deg,	P =     0.000 deg,	R =   180.000 deg
};
P[3]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   -12.000  mm,	Y =    15.000  mm,	Z =    42.000  mm,
	W =   180.000 deg,	P =     0.000 deg,	R =   180.000 deg
};
P[4]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =   -12.000  mm,	Y =    15.000  mm,	Z =    34.000  mm,
	W =   180.000 deg,	P =     0.000 deg,	R =   180.000 deg
};
P[5]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =    72.000  mm,	Y =    15.000  mm,	Z =    34.000  mm,
	W =   180.000 deg,	P =     0.000 deg,	R =   180.000 deg
};
P[6]{
   GP1:
	UF : 1, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	X =    72.000  mm,	Y =    15.000  mm,	Z =    60.000  mm,
	W =   180.000 deg,	P =     0.000 deg,	R =   180.000 deg
};
/END
