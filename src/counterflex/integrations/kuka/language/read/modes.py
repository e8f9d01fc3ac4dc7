"""Assignments, declarations and bas.src of a KRL program: what sets speed, override, frames and orientation."""

from __future__ import annotations

from typing import Final

from counterflex.integrations.kuka.language.read import statements as form
from counterflex.integrations.kuka.language.read.flow import KrlFlow
from counterflex.integrations.kuka.language.read.frames import KrlCell, KrlFrames
from counterflex.integrations.kuka.language.read.job import KrlJob
from counterflex.integrations.kuka.language.read.literals import DECLARED, IMPORT, SIGNAL, key_of
from counterflex.integrations.kuka.language.read.table import ONE_VALUE, TABLE
from counterflex.integrations.kuka.language.read.values import GRAMMAR, StoredFrame, Value, is_frame, matrix_of
from counterflex.programs.expression import Call, ExpressionError, Name, Node, is_number, parse
from counterflex.programs.statement_table import Treatment
from counterflex.programs.unknown import Unknown, first_unknown, known

LARGEST_VELOCITY: Final = 20.0
_FRAMES: Final = {"$TOOL": "TOOL", "$BASE": "BASE"}


class KrlModes(KrlFlow):
    """Modes that are active while a program runs, and the statements that set them."""

    def __init__(self, job: KrlJob, cell: KrlCell | None, *, complete: bool) -> None:
        self.frames = KrlFrames(cell)
        super().__init__(self.frames)
        self.start(job, cell, complete=complete)
        self._speed_set = False
        self.memory.system |= {"$OV_PRO": 100, "$ORI_TYPE": "#VAR", "$IPO_MODE": "#BASE", "$RED_VEL": 100}

    # ---- assignments -----------------------------------------------------------------------------------------

    def _assignment(self, word: str, code: str) -> None:
        """``NAME.PATH[..]=value``, of a variable or of a system variable with its row in the table."""
        match = form.ASSIGNMENT.match(code)
        if match is None:
            raise self._fault("this assignment is not understood", code)
        name = match["name"].upper()
        if name.startswith("$"):
            row = TABLE.find(name)
            if row is None:
                raise self._fault(
                    f"{name} is no system variable that is known, so what it changes is not", code,
                    limit="those of docs/statements/krl.md",
                    hint="Leave it out, or name it in [controller.spindle.krl] (m_codes) if it moves nothing",
                )  # fmt: skip
            if row.treatment is Treatment.REFUSED:
                raise self._fault(f"{name} {row.reason}", code, hint=row.remedy)
            if row.treatment is Treatment.NEUTRAL or name in ONE_VALUE:
                self._note(word, code)
                self.memory.forget(name, (), Unknown(f"{name} is a value of the controller", self.memory.where()))
                value = self._expression(match["value"], code)
                if name in ONE_VALUE:
                    self._check_one_value(name, self._path(match["path"], code), value, code)
                return
        if self.memory.kind(name) == "SIGNAL":
            self._note("$OUT", code)
            return
        value = self._expression(match["value"], code)
        path = self._path(match["path"], code)
        self._set(name, path, value, code, match.start("value"))

    def _check_one_value(self, name: str, path: list[object], value: Value, code: str) -> None:
        """Refuse a value of a system variable that changes the path."""
        component, only, what, remedy = ONE_VALUE[name]
        given: object = value
        if component and isinstance(value, dict):
            given = value.get(component, only)
        elif component and str(path[-1] if path else component).upper() != component:
            return
        if given != only:
            full = f"{name}.{component}" if component else name
            raise self._fault(what, code, limit=f"{full}={str(only).upper()}", hint=remedy)

    def _expression(self, text: str, code: str) -> Value:
        text = text.strip()
        if not text:
            raise self._fault("a value is missing", code, hint="The line may be cut off")
        return self.value(self._tree(text, code), code)

    def _path(self, text: str, code: str) -> list[object]:
        """Components and indices of an assignment."""
        if not text.strip():
            return []
        node = self._tree(f"N{text}", code)
        if not isinstance(node, Name):
            raise self._fault("this assignment is not understood", code)
        steps = [
            step if isinstance(step, str) else tuple(self.value(item, code) for item in step) for step in node.path
        ]
        return [step for step in steps if step != ()]

    def _set(self, name: str, path: list[object], value: Value, code: str, at: int) -> None:
        """Give a variable a value, and take notice of one that a motion depends on."""
        try:
            self.memory.assign(name, path, value)
        except ExpressionError as error:
            raise self._fault(f"this is not understood: {error}", code) from error
        if name in _FRAMES:
            self._take_frame(name, f"{self.module.file.name}:{self.line}:{at + 1}")
        elif name == "$VEL":
            self._speed_set = True

    def _take_frame(self, name: str, where: str) -> None:
        value = self.memory.system[name]
        self.frames.take(_FRAMES[name], value, where)
        cell = self.frames.krl_cell
        if name == "$BASE" and cell is not None and is_frame(value) and cell.is_part_frame(matrix_of(value)):  # type: ignore[arg-type]
            self.memory.system[name] = StoredFrame("BASE_DATA", cell.base_number, cell.T_part)

    def _declaration(self, code: str) -> None:
        """``DECL INT N, M``; a value behind ``=`` is given each time the routine runs."""
        text = code.strip()
        if (signal := SIGNAL.fullmatch(code)) is not None:
            self.memory.declare(signal[1], "SIGNAL")
            return
        if text.upper().startswith("IMPORT"):
            match = IMPORT.fullmatch(code)
            if match is not None:
                module = match[2].rstrip("/").rsplit("/", 1)[-1].upper()
                self.memory.imports(match[1].upper(), (module, match[3].upper()))
            return
        match = DECLARED.fullmatch(code)
        if match is None:
            return
        kind = (match["type"] or "").upper()
        rest = match["rest"] or ""
        self.memory.declare(match["name"], kind)
        if rest.startswith("="):
            path = self._path(match["index"] or "", code)
            self._set(match["name"].upper(), path, self._expression(rest[1:], code), code, match.start("rest") + 1)
        else:
            for part in rest.split(","):
                name = key_of(part).split("[")[0]
                if name and not name[0].isdigit():
                    self.memory.declare(name, kind)

    # ---- values that a motion needs --------------------------------------------------------------------------

    def speed(self, value: Value, code: str) -> float:
        """A path speed with the program's override, m/s. Raises ProgramError: it is not known, or out of range."""
        where = self.at(code)
        given = known(value, "the path speed", where, text=code, hint="Write $VEL.CP= with the number, in m/s")
        if not is_number(given) or not 0.0 < given <= LARGEST_VELOCITY:  # type: ignore[operator]
            raise self._fault(
                "the path speed is no number in range", code,
                limit=f"$VEL.CP above 0, at most {LARGEST_VELOCITY:g} m/s",
                hint="Write the number itself, in m/s",
            )  # fmt: skip
        return float(given) * self.override(code)  # type: ignore[arg-type]

    def override(self, code: str) -> float:
        """Share of the programmed speed that $OV_PRO leaves. Raises ProgramError: it is not known."""
        where = self.at(code)
        for name, least in (("$RED_VEL", 100), ("$OV_PRO", 1)):
            value = known(
                self.memory.system[name],
                f"the override {name}",
                where,
                text=code,
                hint=f"Leave {name} as the operator sets it",
            )
            if not is_number(value) or not least <= value <= 100:  # type: ignore[operator]
                raise self._fault(
                    f"the override {name} is not in range", code, limit=f"{least} .. 100 %", hint=f"Leave {name} out"
                )
        return float(self.memory.system["$OV_PRO"]) / 100.0  # type: ignore[arg-type]

    def active_speed(self, code: str) -> float:
        """$VEL.CP with the override, m/s. Raises ProgramError: the program has not set it, or it is not known."""
        speeds = self.memory.system.get("$VEL")
        value = speeds.get("CP") if isinstance(speeds, dict) else speeds
        if value is None:
            raise self._fault(
                "a motion along the path before $VEL.CP is set", code, limit="$VEL.CP=0.025 (m/s)",
                hint="Set it in the program: the speed decides about the force",
            )  # fmt: skip
        return self.speed(value, code)

    def mode(self, name: str, code: str) -> str:
        """A mode such as $ORI_TYPE. Raises ProgramError: it is not known."""
        where = self.at(code)
        value = known(self.memory.system.get(name, ""), name, where, text=code, hint=f"Set {name} itself")
        return str(value)

    # ---- bas.src ---------------------------------------------------------------------------------------------

    def _basic(self, code: str) -> None:
        match = form.BASIC.fullmatch(code)
        word = "" if match is None else match[1].upper()
        row = TABLE.find(f"BAS #{word}")
        if match is None or row is None or row.treatment is Treatment.REFUSED:
            raise self._fault(
                f"BAS{f' with #{word}' * bool(word)} is not read", code,
                limit="INITMOV VEL_CP CP_PARAMS PTP_PARAMS CP_DAT PTP_DAT TOOL BASE FRAMES VEL_PTP ACC_PTP ACC_CP",
                hint="Write out what it sets" if row is None else row.remedy,
            )  # fmt: skip
        if row.treatment is Treatment.NEUTRAL:
            return
        where = f"{self.module.file.name}:{self.line}"
        if word == "INITMOV":
            self._initialised(code, where)
            return
        if word in ("VEL_CP", "CP_PARAMS"):
            self._set("$VEL", ["CP"], self._expression(match[2] or "", code), code, 0)
        elif word in ("TOOL", "BASE"):
            number = self._expression(match[2] or "", code)
            self._numbered(word, number, code)
        if word in ("CP_DAT", "CP_PARAMS"):
            self._motion_data(code, whole=word == "CP_DAT")
        if word in ("CP_PARAMS", "PTP_PARAMS", "FRAMES") and self.memory.declared("FDAT_ACT"):
            self._frame_data(code)

    def _initialised(self, code: str, where: str) -> None:
        """``BAS(#INITMOV,0)``: what bas.src resets."""
        speed = self.memory.value_of("DEF_VEL_CP", ())
        if isinstance(speed, Unknown):
            speed = Unknown("BAS(#INITMOV,0) sets it to DEF_VEL_CP, which no data list of the folder gives", where)
        self._set("$VEL", ["CP"], speed, code, 0)
        self.memory.assign("$BASE", (), dict.fromkeys("XYZABC", 0.0))
        if self.memory.doubt is None:
            self.frames.reset_base(where)
        else:
            self._take_frame("$BASE", where)
        for name, value in (("$IPO_MODE", "#BASE"), ("$ORI_TYPE", "#VAR")):
            self.memory.assign(name, (), value)

    def _numbered(self, word: str, number: Value, code: str) -> None:
        """$TOOL or $BASE by a number."""
        name, value = f"${word}", number
        if first_unknown(number) is None:
            if not is_number(number) or number != int(number):  # type: ignore[call-overload]
                raise self._fault(f"{word} needs a number", code, hint="Write the number itself")
            value = self.memory.numbered(f"{word}_DATA", int(number))  # type: ignore[call-overload]
        self._set(name, [], value, code, len(code) - len(code.lstrip()))

    def _motion_data(self, code: str, *, whole: bool) -> None:
        """Speed and kind of orientation of LDAT_ACT."""
        data = self.memory.value_of("LDAT_ACT", ())
        if whole:
            speed = data.get("VEL") if isinstance(data, dict) else data
            if speed is None:
                speed = Unknown("LDAT_ACT has no VEL", self.memory.where())
            self._set("$VEL", ["CP"], speed, code, 0)
        kind = data.get("ORI_TYP") if isinstance(data, dict) else None
        if kind is not None:
            self.memory.assign("$ORI_TYPE", (), kind)

    def _frame_data(self, code: str) -> None:
        """Tool, base and interpolation mode of FDAT_ACT."""
        data = self.memory.value_of("FDAT_ACT", ())
        for word in ("TOOL", "BASE"):
            number = data.get(f"{word}_NO") if isinstance(data, dict) else data
            if number is None or (not isinstance(number, Unknown) and not is_number(number)):
                number = Unknown(f"{word}_NO of FDAT_ACT is not given", self.memory.where())
            self._numbered(word, number, code)
        mode = data.get("IPO_FRAME") if isinstance(data, dict) else None
        if mode is not None:
            self.memory.assign("$IPO_MODE", (), mode)

    # ---- calls -----------------------------------------------------------------------------------------------

    def _call_statement(self, code: str) -> None:
        """A subprogram of the job, or a routine of a library that the table names."""
        try:
            node, end = parse(code, GRAMMAR)
        except ExpressionError as error:
            node, end = self._with_gaps(code, error), len(code)
        if not isinstance(node, Call) or code[end:].strip():
            raise self._fault(
                "an unknown statement", code, hint="docs/statements/krl.md lists what is read; post the path without it"
            )
        routine = self.job.routine(node.name, self.module, self.memory.where())
        if routine is not None:
            self._call(routine, node.arguments)
            return
        self._library(node.name, node.arguments)

    def _with_gaps(self, code: str, error: ExpressionError) -> Node:
        """A call of a library whose arguments are not all given: ``VENDOR( , 3)``."""
        match = form.CALL.fullmatch(code)
        if match is None or (TABLE.find(match[1]) is None and match[1].upper() not in self.job.main.routines):
            if match is not None:
                raise self._unknown_call(match[1], code) from error
            raise self._fault(
                "an unknown statement", code, hint="docs/statements/krl.md lists what is read; post the path without it"
            ) from error
        return Call(match[1], (), {}, 0, len(code))

    def _unknown_call(self, name: str, code: str) -> Exception:
        return self._fault(
            f"a subprogram is called, which may move the robot, and no file of the folder has {name}", code,
            limit=f"DEF {name}( ) in the file, or {name}.src beside it; or a statement of [controller.spindle.krl]",
            hint="Give its file too, or name the call in the table (m_codes) if it moves nothing",
        )  # fmt: skip

    def _is_library(self, name: str) -> bool:
        row = TABLE.find(name)
        return row is not None and row.treatment is not Treatment.EVALUATED

    def _library(self, name: str, arguments: tuple[Node, ...] | list[Node]) -> Value:  # type: ignore[override]
        row, code = TABLE.find(name), self._code
        if row is None or row.treatment is Treatment.EVALUATED or not name[0].isalpha():
            raise self._unknown_call(name, code)
        if row.treatment is Treatment.REFUSED:
            raise self._fault(f"{name}: {row.reason}", code, hint=row.remedy)
        self._note(row.word.upper(), code)
        unknown = Unknown(f"{name} gives it", self.memory.where())
        for node in arguments:
            if isinstance(node, Name) and not node.text.startswith("$") and self.memory.declared(node.text):
                self.memory.forget(node.text, self._path(code[node.start : node.end][len(node.text) :], code), unknown)
        return unknown

    def _note(self, word: str, code: str) -> None:
        """A statement that acts on the cell."""
        raise NotImplementedError
