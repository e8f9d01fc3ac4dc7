"""States of the loop, places of its numbers, and the supervisor that moves between states."""
