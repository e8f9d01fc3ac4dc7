"""All rules on one set-up."""

from __future__ import annotations

from counterflex.integrations.kuka.link.check import (
    context as rsi_rules_context,
    ethernet as rsi_rules_ethernet,
    objects as rsi_rules_objects,
    program as rsi_rules_program,
    variables as rsi_rules_variables,
    wiring as rsi_rules_wiring,
)
from counterflex.integrations.kuka.link.whole_setup import Setup
from counterflex.protocols.finding import Finding

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
    findings = [finding for rule in RULES for finding in rule(setup)]
    return tuple(sorted(findings, key=lambda finding: finding.severity != "error"))
