"""A finding about the set-up of a controller: what is dangerous or useless, where, and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Finding:
    """Something dangerous (error) or useless (warning) in a set-up."""

    rule: str  # name of the rule
    severity: Severity  # ``error``: must not run so; ``warning``: should be looked at
    where: str  # file, and place in it
    what: str  # the fault
    value: str  # as found
    safe: str  # what is safe
    hint: str  # what to do

    def line(self) -> str:
        """All of it in one line."""
        text = f"{self.severity} [{self.rule}] {self.where}: {self.what}; found {self.value}; safe: {self.safe}"
        return " ".join(f"{text}. {self.hint}".split())
