"""Write the scripts of the example gallery as notebooks.

    python tools/notebooks.py [FOLDER]

FOLDER is ``out/notebooks`` unless stated. The notebooks are those that the pages of the gallery offer for download.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from sphinx_gallery import gen_gallery, notebook, py_source_parser

from counterflex.core import atomic
from docs_site.gallery import SCRIPTS, scripts


def notebook_of(script: Path) -> dict[str, Any]:
    """A script as a notebook, as the documentation offers it."""
    _, blocks = py_source_parser.split_code_and_text_blocks(str(script))
    blocks = [
        (label, py_source_parser.remove_config_comments(text), line) if label == "code" else (label, text, line)
        for label, text, line in blocks
    ]
    settings = {**gen_gallery.DEFAULT_GALLERY_CONF, "notebook_extensions": set()}
    made: dict[str, Any] = notebook.jupyter_notebook(blocks, settings, str(script.parent))
    return made


def main(folder: Path) -> int:
    """Write them all."""
    for script in scripts():
        target = folder / script.relative_to(SCRIPTS).with_suffix(".ipynb")
        target.parent.mkdir(parents=True, exist_ok=True)
        atomic.write_text(target, json.dumps(notebook_of(script), indent=1) + "\n")
        print(target)
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("out/notebooks")))
