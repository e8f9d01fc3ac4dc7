"""Figures of ISO 230 from measured paths: circular tests (part 4) and straightness (part 1)."""
