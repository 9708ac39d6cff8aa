#!/usr/bin/env bash
# The calls of pyOMA2 and SIPPY that docs/coming_from.md shows, beside ours, in an environment of
# their own: they need 900 MB that nothing else does. Skipped where they cannot be installed.
set -euo pipefail
cd "$(dirname "$0")/../.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
git ls-files -z | tar --create --null --files-from - | tar --extract --directory "$work"
python3 -m venv "$work/.venv"
python="$work/.venv/bin/python"
if ! "$python" -m pip install --quiet "sippy-unipi==1.0.1" "pyOMA-2==1.4.3"; then
    echo "peers.sh: skipped, SIPPY or pyOMA2 cannot be installed"
    exit 0
fi
"$python" -m pip install --quiet "$work[report]"
cd "$work"
"$python" tests/packaging/peers.py
