#!/usr/bin/env bash
# Remake the lock files: names, versions and hashes for every supported platform and Python, and nothing else.
# Needs uv (pip install uv).
set -euo pipefail
cd "$(dirname "$0")/.."
compile() {
  uv pip compile pyproject.toml requirements/build.in "$@" --constraint requirements/constraints.in \
    --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-emit-find-links \
    --no-header --no-annotate --quiet
}
compile --output-file requirements/run.txt
compile --group dev --group docs --extra urdf --output-file requirements/dev.txt
