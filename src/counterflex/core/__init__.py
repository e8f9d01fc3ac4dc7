"""Foundations every other room stands on: errors, units, array checks, kernels, safe writing."""
