"""The elastic chain: deflection under load, own weight, lost motion, drives that yield."""
