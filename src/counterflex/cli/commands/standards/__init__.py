"""Commands that compute the figures of standards from raw measurements."""
