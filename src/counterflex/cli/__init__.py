"""The command line: arguments in shop units in, jobs called, tables printed. No logic of its own."""
