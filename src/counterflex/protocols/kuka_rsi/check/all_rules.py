"""All rules on one set-up."""

from __future__ import annotations

from counterflex.protocols.finding import Finding
from counterflex.protocols.kuka_rsi.check import context as rsi_rules_context
from counterflex.protocols.kuka_rsi.check import ethernet as rsi_rules_ethernet
from counterflex.protocols.kuka_rsi.check import objects as rsi_rules_objects
from counterflex.protocols.kuka_rsi.check import program as rsi_rules_program
from counterflex.protocols.kuka_rsi.check import variables as rsi_rules_variables
from counterflex.protocols.kuka_rsi.check import wiring as rsi_rules_wiring
from counterflex.protocols.kuka_rsi.setup import Setup

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
