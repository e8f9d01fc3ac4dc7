"""Commands that start one simulated controller or instrument by itself."""
