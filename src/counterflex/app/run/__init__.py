"""Correct while milling: the processes of a run, its status, its end and its log."""
