#!/usr/bin/env bash
# Remake docs/images/report.png from a report (default: the one of `make demo`). Needs chromium.
set -euo pipefail
cd "$(dirname "$0")/.."
report=$(realpath "${1:-out/demo/report.html}")
test -f "$report"
chromium --headless --no-sandbox --disable-gpu --hide-scrollbars --force-device-scale-factor=0.8 \
  --window-size=1320,1035 --virtual-time-budget=15000 --screenshot=docs/images/report.png "file://$report" 2>/dev/null
ls -l docs/images/report.png
