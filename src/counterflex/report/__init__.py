"""One self-contained HTML page per job: what was machined, how far it was off, before and after."""
