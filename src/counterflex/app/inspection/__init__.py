"""Real parts judged against the program that made them."""
