"""Seeded truths for each recipe, with and without what the recipe's own model lacks."""
