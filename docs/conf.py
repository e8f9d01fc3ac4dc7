"""Sphinx settings: `make docs-html` builds docs/_build/html, offline, with every warning an error."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))

from docs_site import gallery

project = "counterflex"
author = "the counterflex authors"
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "docs_site.gallery",
    "docs_site.command_help",
    "docs_site.rooms",
    "sphinx_gallery.gen_gallery",
]
myst_heading_anchors = 3
html_theme = "furo"
html_title = "counterflex"
html_static_path = ["_static"]
exclude_patterns = ["_build", "gallery/**/*.ipynb", "gallery/**/*.py"]
html_copy_source = False
html_show_copyright = False

sphinx_gallery_conf = {
    "examples_dirs": ["../examples/gallery"],
    "gallery_dirs": [gallery.PAGES],
    "filename_pattern": r"\.py$",
    "subsection_order": [f"../examples/gallery/{section}" for section in gallery.SECTIONS],
    "within_subsection_order": "FileNameSortKey",
    "nested_sections": False,
    "run_stale_examples": True,  # what a page shows is what the code of today says
    "abort_on_example_error": True,
    "capture_repr": ("_repr_html_",),
    "image_scrapers": (),
    "reset_modules": (),
    "thumbnail_size": (400, 280),
    "show_signature": False,
    "show_memory": False,
    "write_computation_times": False,
    "remove_config_comments": True,
    "backreferences_dir": None,
    "doc_module": (),
}

autodoc_member_order = "bysource"
autodoc_type_aliases = {name: name for name in ("Float", "Float32", "Int", "Bool", "Complex")}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
napoleon_custom_sections = ["Source"]
python_use_unqualified_type_names = True
toc_object_entries = False  # thousands of entries, which every page would copy: a third of the build
