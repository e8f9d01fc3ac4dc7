"""The job ``correct``: the next part corrected from measured ones."""
