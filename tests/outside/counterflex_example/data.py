"""Data files: a robot in the form of the catalogue, and a table of materials."""

from pathlib import Path

ROBOT = Path(__file__).with_name("example_arm.toml")
MATERIALS = Path(__file__).with_name("materials.csv")
