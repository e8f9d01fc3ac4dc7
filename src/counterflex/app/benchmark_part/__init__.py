"""A part that any laboratory can mill, measure and compare: program, drawing, tolerances, evaluation, results."""
