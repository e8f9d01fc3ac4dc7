"""The studio: a folder as a project in the browser, each action the command line that is shown beside it."""
