"""Datasets: manifests, tables of any laboratory, units, and proposals of measurements."""
