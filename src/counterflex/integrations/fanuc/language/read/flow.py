"""Branches, jumps and loops of a FANUC program."""

from __future__ import annotations

import re
from abc import abstractmethod
from typing import Final, cast

from counterflex.integrations.fanuc.language.read.branches import TpBranches, TpStep, divided
from counterflex.integrations.fanuc.language.read.motion_form import MOTION
from counterflex.integrations.fanuc.language.read.table import row_of
from counterflex.integrations.fanuc.language.read.values import plain_code
from counterflex.programs.expression import Value, is_number
from counterflex.programs.unknown import Unknown

_I: Final = re.IGNORECASE
_BLOCK: Final = re.compile(r"IF\s*(.*)\bTHEN", _I | re.DOTALL)
_FOR: Final = re.compile(r"FOR\s+(R\s*\[.*?\])\s*=\s*(.*?)\s+(TO|DOWNTO)\s+(.*)", _I | re.DOTALL)
_SELECT: Final = re.compile(r"SELECT\s+(.*?\])\s*(=.*)", _I | re.DOTALL)
JUMP: Final = re.compile(r"JMP\s+LBL\s*\[(.*)\]", _I | re.DOTALL)


class TpFlow(TpBranches):
    """Decides which statement follows."""

    @abstractmethod
    def statement(self, step: TpStep) -> int:
        """Execute a statement; returns the index of the next one."""

    # ---- flow ----------------------------------------------------------------------------------------------

    def do_if(self, step: TpStep) -> int:
        """IF with a statement behind its comma, or a block up to ENDIF."""
        block = _BLOCK.fullmatch(step.text)
        if block is None:
            condition, action = divided(step.text[2:], most=2) if "," in step.text else (step.text[2:], "")
            decision = self._decision(step, condition)
            if decision is False:
                return step.at + 1
            return self._action(step, action.strip(), decision)
        decision = self._decision(step, block[1])
        end, other = step.routine.ends[step.at], step.routine.elses.get(step.at)
        if isinstance(decision, Unknown):
            self.act(step)
            self.pass_over(step.routine, step.at + 1, end, decision, ("IF", step.statement.line))
            return end + 1
        return step.at + 1 if decision else end + 1 if other is None else other + 1

    def _decision(self, step: TpStep, text: str) -> bool | Unknown:
        value = self.value(step, text)
        if isinstance(value, Unknown):
            return Unknown(value.why, value.where or step.line)
        if not isinstance(value, bool):
            raise step.fault("this is no condition", limit="IF (R[1]=2)", hint="Post the program again")
        return value

    def _action(self, step: TpStep, action: str, decision: bool | Unknown) -> int:
        """Do what stands behind the comma of IF or SELECT; returns the index of the next statement."""
        if isinstance(decision, Unknown):
            self.act(step)
            jump = JUMP.fullmatch(action)
            if jump is not None:
                number = self.number(step, jump[1], "the label of a jump")
                return self.jump_perhaps(step, number, decision)
            opening = (step.routine.texts[step.at].split()[0], step.statement.line)
            self._pass_action(step, action, decision, opening, 0)
            return step.at + 1
        if row_of(action) is None or MOTION.match(action):
            raise step.fault("what stands under the condition is not understood", limit="IF R[1]=2,JMP LBL[1]",
                             hint="Post the program again")  # fmt: skip
        return self.statement(step._replace(text=action))

    def number(self, step: TpStep, text: str, use: str) -> int:
        """Return a whole number that a statement needs."""
        value = step.known(self.value(step, plain_code(f"[{text}]")[1:-1]), use, hint="Write the number itself")
        if not is_number(value):
            raise step.fault(f"{use} is no number", hint="Write the number itself")
        return int(cast("float", value))

    def do_jump(self, step: TpStep) -> int:
        """JMP to a label."""
        match = JUMP.fullmatch(step.text)
        if match is None:
            raise step.fault("the jump is not understood", limit="JMP LBL[1]")
        number = self.number(step, match[1], "the label of a jump")
        if number not in step.routine.labels:
            raise step.fault(f"there is no LBL[{number}]", hint="The file may be damaged")
        return step.routine.labels[number]

    def do_else(self, step: TpStep) -> int:
        """ELSE behind the first branch: go on behind ENDIF."""
        if step.at not in step.routine.elses:
            raise step.fault("this belongs into IF or SELECT", hint="The file may be damaged")
        return step.routine.ends[step.routine.elses[step.at]] + 1

    def do_select(self, step: TpStep) -> int:
        """SELECT: the first branch whose value fits."""
        match = _SELECT.fullmatch(step.text)
        if match is None:
            raise step.fault("SELECT is not understood", limit="SELECT R[1]=1,CALL PART")
        value = self.value(step, match[1])
        end = _select_end(step)
        cases = [match[2], *step.routine.texts[step.at + 1 : end]]
        if isinstance(value, Unknown):
            condition = Unknown(value.why, value.where or step.line)
            for index, case in enumerate(cases, start=step.at):
                action = case.partition(",")[2].strip()
                if action:
                    self._action(step.other(index), action, condition)
            return end
        chosen = next((case.partition(",")[2].strip() for case in cases if self._fits(step, case, value)), "")
        if not chosen:
            return end
        then = self.statement(step._replace(text=chosen))
        return end if then == step.at + 1 else then

    def _fits(self, step: TpStep, case: str, value: Value) -> bool:
        """Return whether a branch of SELECT is for a value."""
        label = case.partition(",")[0].strip()
        if not label or label.upper() == "ELSE":
            return bool(label)
        own = self.value(step, label[1:])
        return step.known(own, "a value of SELECT", text=case, hint="Write the number itself") == value

    def do_case(self, step: TpStep) -> int:
        """Refuse a branch of SELECT that stands alone."""
        raise step.fault("this belongs into SELECT", hint="The file may be damaged")

    def do_for(self, step: TpStep) -> int:
        """FOR: set the counter; leave out the loop where it is beyond its end."""
        match = _FOR.fullmatch(step.text)
        if match is None:
            raise step.fault("FOR is not understood", limit="FOR R[1]=1 TO 5")
        first, last = self.value(step, match[2]), self.value(step, match[4])
        end = step.routine.ends[step.at]
        unknown = next((one for one in (first, last) if isinstance(one, Unknown)), None)
        if unknown is not None:
            self.act(step)
            condition = Unknown(unknown.why, unknown.where or step.line)
            self.pass_over(step.routine, step.at, end, condition, ("FOR", step.statement.line))
            return end + 1
        word, indices, _ = self.target_of(step, f"{match[1]}=0")
        self.values.assign(word, indices, first)
        by = 1 if match[3].upper() == "TO" else -1
        runs = by * cast("float", first) <= by * cast("float", last)
        return step.at + 1 if runs else end + 1

    def do_end_for(self, step: TpStep) -> int:
        """Count on and go back while the last value is not reached (Operator's manual, FOR/ENDFOR)."""
        begin = step.routine.ends[step.at]
        match = _FOR.fullmatch(step.routine.texts[begin])
        if match is None:
            return step.at + 1
        opening = step.other(begin)
        counter, last = self.value(opening, match[1]), self.value(opening, match[4])
        for one in (counter, last):
            opening.known(one, "how often FOR repeats")
        by = 1 if match[3].upper() == "TO" else -1
        if by * cast("float", counter) >= by * cast("float", last):
            return step.at + 1
        word, indices, _ = self.target_of(opening, f"{match[1]}=0")
        self.values.assign(word, indices, cast("float", counter) + by)
        return begin + 1

    def _end(self, step: TpStep) -> int:
        return len(step.routine.statements)

    def _abort(self, step: TpStep) -> int:
        self._ended = True
        return step.at + 1


def _select_end(step: TpStep) -> int:
    """Index behind the last branch of SELECT."""
    texts = step.routine.texts
    end = last = step.at + 1
    while end < len(texts) and (not texts[end] or texts[end][:1] == "=" or texts[end][:5].upper() == "ELSE,"):
        end += 1
        last = end if texts[end - 1] else last
    return last
