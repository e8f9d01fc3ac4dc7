"""All that knows a maker of controllers, robots or instruments; nothing else does."""
