"""The laboratory that proves counterflex: fault injection, reproduced papers, hours of the loop."""
