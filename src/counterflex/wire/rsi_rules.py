"""All rules on one set-up."""

from __future__ import annotations

from counterflex.wire import (
    rsi_rules_context,
    rsi_rules_ethernet,
    rsi_rules_objects,
    rsi_rules_program,
    rsi_rules_variables,
    rsi_rules_wiring,
)
from counterflex.wire.rsi_setup import Finding, Setup

RULES = (
    *rsi_rules_ethernet.RULES,
    *rsi_rules_wiring.RULES,
    *rsi_rules_objects.RULES,
    *rsi_rules_context.RULES,
    *rsi_rules_program.RULES,
    *rsi_rules_variables.RULES,
)


def check(setup: Setup) -> tuple[Finding, ...]:
    """Findings, errors first, each kind in the order of the rules.

    Raises:
        FileFormatError: A parameter that a rule needs is not a number.
    """
    found = [finding for rule in RULES for finding in rule(setup)]
    return tuple(sorted(found, key=lambda finding: finding.severity != "error"))
