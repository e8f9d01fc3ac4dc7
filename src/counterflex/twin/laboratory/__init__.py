"""The measuring equipment around the simulated cell, one module per kind of dataset."""
