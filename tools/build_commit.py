"""Hook of the build: the commit goes into wheel and source distribution, for ``counterflex --version``.

A source distribution has no git folder; a wheel that is built from one takes the file that it brings. Where
``tools/build_wheels.py`` names compiled kernels, they go into the wheel, which is then one of this Python and platform.
"""

from __future__ import annotations

import importlib.util
import os
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_PLACES = {"wheel": "counterflex/commit.txt", "sdist": "src/counterflex/commit.txt"}


class CommitHook(BuildHookInterface[Any]):
    """Writes the commit, where it is known, beside the package."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the file; an editable installation reads git itself.

        Args:
            version: Kind of the build.
            build_data: Its settings.
        """
        root = Path(self.root)
        if (kernels := os.environ.get("COUNTERFLEX_KERNELS")) and self.target_name == "wheel" and version != "editable":
            build_data["force_include"][kernels] = "counterflex/kernels"
            python = f"cp{sys.version_info[0]}{sys.version_info[1]}"
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["pure_python"] = False
            build_data["tag"] = f"{python}-{python}-{platform.replace('linux_', 'manylinux_2_28_')}"
        if version == "editable" or self.target_name not in _PLACES or (root / "src/counterflex/commit.txt").exists():
            return
        spec = importlib.util.spec_from_file_location("build_data", root / "src/counterflex/core/build_data.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        commit = module.commit_of(root)
        if commit is None:
            return
        file = Path(tempfile.mkdtemp(prefix="counterflex-build-")) / "commit.txt"
        file.write_text(commit + "\n", encoding="utf-8")
        build_data["force_include"][str(file)] = _PLACES[self.target_name]
