"""Set up a simulated cell as a laboratory would, recipe by recipe, and show what that is worth."""
