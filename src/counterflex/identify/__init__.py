"""Identification of a cell from measurements: named parameters, datasets, residuals, solver, one recipe per thing."""
