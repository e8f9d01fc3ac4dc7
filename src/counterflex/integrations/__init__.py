"""All that knows a maker of controllers, robots or instruments: a folder each, found by its ``ENTRY_POINTS``."""
