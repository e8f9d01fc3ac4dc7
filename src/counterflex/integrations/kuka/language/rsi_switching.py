"""KUKA KRL: statements that switch the sensor correction on and off, and the routines that they call."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from counterflex.integrations.kuka.language import krl_wait

_INTERRUPT: Final = 21


_AT_ZERO: Final = 0.005


_ARMED: Final = "($SEN_PREA[{0}]>1.5) AND ($SEN_PREA[{0}]<2.5)"


@dataclass(frozen=True)
class RsiSwitching:
    """Settings that switch the correction on and off."""

    context: str  # Name that RSI_CREATE takes
    parameters: tuple[tuple[str, str, float], ...]  # Object, parameter and value for RSI_SETPUBLICPAR, in mm and deg
    cycle_ms: int  # 4 (#IPO_FAST) or 12 (#IPO)
    enable_index: int  # $SEN_PREA that says that the correction may act
    feed_hold_index: int  # $SEN_PREA through which the sensor asks for a feed hold
    state_index: int  # $SEN_PREA in which the loop says its state (:class:`counterflex.runtime.state.supervisor.State`)
    correction_index: int  # First of the six $SEN_PREA in which the controller says what it has corrected, mm and deg
    armed_s: float  # How long the program waits for the loop to be armed until it stops
    zero_s: float  # How long it waits for the correction to be back at zero until it stops
    output: int | None = None  # Number of $OUT that is TRUE while the correction may act, or None

    def output_of(self, *, on: bool) -> list[str]:
        """Output for a safety PLC: TRUE from before the correction is enabled until it is back at zero."""
        if self.output is None:
            return []
        return [f"$OUT[{self.output}]={'TRUE' if on else 'FALSE'} ; sensor correction {'may act' if on else 'is off'}"]

    def on_lines(self) -> list[str]:
        """Statements that make the context and switch RSI on."""
        rate = "#IPO" if self.cycle_ms == 12 else "#IPO_FAST"
        indices = [self.feed_hold_index, self.enable_index, self.state_index]
        indices += [self.correction_index + i for i in range(6)]
        lines = [
            "; sensor correction on",
            *(f"$SEN_PREA[{index}]=0.0" for index in indices),
            f'cfr=RSI_CREATE("{self.context}",cfid,TRUE)',
            "CF_CHECK(cfr)",
        ]
        for item, parameter, value in self.parameters:
            lines += [f'cfr=RSI_SETPUBLICPAR(cfid,"{item}","{parameter}",{value:.3f})', "CF_CHECK(cfr)"]
        return [
            *lines,
            "HALT ; start counterflex run, then press start",
            f"cfr=RSI_ON(#ABSOLUTE,{rate})",
            "CF_CHECK(cfr)",
            f"INTERRUPT DECL {_INTERRUPT} WHEN $SEN_PREA[{self.feed_hold_index}]>0.5 DO CF_HOLD( )",
            f"INTERRUPT ON {_INTERRUPT}",
        ]

    def enable_lines(self, value: float) -> list[str]:
        """Statements that wait for the loop and let the correction act."""
        return [
            "; wait until the loop reports that it is armed",
            *krl_wait(_ARMED.format(self.state_index), self.armed_s, "counterflex run is not armed"),
            *self.output_of(on=True),
            f"$SEN_PREA[{self.enable_index}]={value:.1f}",
        ]

    def off_lines(self) -> list[str]:
        """Statements that wait for zero correction and switch RSI off."""
        return [
            "; sensor correction off: wait until the controller reports zero correction",
            "WAIT SEC 0.0",
            f"$SEN_PREA[{self.enable_index}]=0.0",
            *krl_wait("CF_ZERO( )", self.zero_s, "the correction is not back at zero"),
            *self.output_of(on=False),
            f"INTERRUPT OFF {_INTERRUPT}",
            "cfr=RSI_OFF()",
            "CF_CHECK(cfr)",
            "cfr=RSI_DELETE(cfid)",
            "CF_CHECK(cfr)",
        ]

    def routine_lines(self) -> list[str]:
        """Subprograms at the end of the module."""
        first = self.correction_index
        return [
            "",
            "DEF CF_CHECK(cfresult:IN)",
            "; no way past a call of RSI that failed: reset the program",
            "DECL INT cfresult",
            "IF cfresult<>RSIOK THEN",
            "LOOP",
            "HALT",
            "ENDLOOP",
            "ENDIF",
            "END",
            "",
            "DEF CF_HOLD( )",
            "; the sensor asks for a feed hold: stand on the path until it takes that back",
            "BRAKE",
            f"WAIT FOR $SEN_PREA[{self.feed_hold_index}]<0.5",
            "END",
            "",
            "DEFFCT BOOL CF_ZERO( )",
            "; the loop has stopped correcting, and the controller reports zero correction",
            "DECL INT cfi",
            f"IF $SEN_PREA[{self.state_index}]>2.5 THEN",
            "RETURN FALSE",
            "ENDIF",
            f"FOR cfi={first} TO {first + 5}",
            f"IF ABS($SEN_PREA[cfi])>{_AT_ZERO:.3f} THEN",
            "RETURN FALSE",
            "ENDIF",
            "ENDFOR",
            "RETURN TRUE",
            "ENDFCT",
        ]


_DECLARED: Final = ("DECL INT cfr", "DECL INT cfid")


_INI: Final = (
    ";FOLD INI",
    ";FOLD BASISTECH INI",
    "GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )",
    "INTERRUPT ON 3",
    "BAS (#INITMOV,0 )",
    ";ENDFOLD (BASISTECH INI)",
    ";ENDFOLD (INI)",
)
