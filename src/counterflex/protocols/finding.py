"""A finding about the set-up of a controller: what is dangerous or useless, where, and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Finding:
    """Something dangerous (error) or useless (warning) in a set-up.

    Attributes:
        rule: Name of the rule.
        severity: ``error``: must not run so; ``warning``: should be looked at.
        where: File, and place in it.
        what: The fault.
        value: As found.
        safe: What is safe.
        hint: What to do.
    """

    rule: str
    severity: Severity
    where: str
    what: str
    value: str
    safe: str
    hint: str

    def line(self) -> str:
        """All of it in one line."""
        text = f"{self.severity} [{self.rule}] {self.where}: {self.what}; found {self.value}; safe: {self.safe}"
        return " ".join(f"{text}. {self.hint}".split())
