"""Sphinx settings: `make docs-html` builds docs/_build/html, offline, with every warning an error."""

from __future__ import annotations

project = "counterflex"
author = "the counterflex authors"
extensions = ["myst_parser"]
myst_heading_anchors = 3
html_theme = "furo"
html_title = "counterflex"
exclude_patterns = ["_build"]
html_copy_source = False
html_show_copyright = False
