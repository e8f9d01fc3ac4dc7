"""What proves counterflex itself: fault injection, reproduced papers, hours of the loop."""
