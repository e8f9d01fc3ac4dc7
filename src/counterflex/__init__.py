"""Counterflex: plan, prove and correct the elastic deflection of milling robots."""

__version__ = "0.1.0"
