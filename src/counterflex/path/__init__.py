"""The tool path: poses of the tool in the part frame over time, free of any program language."""

from counterflex.path.toolpath import FEED, RAPID, ToolPath

__all__ = ["FEED", "RAPID", "ToolPath"]
