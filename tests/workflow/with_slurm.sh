#!/usr/bin/env bash
# Runs a command where a SLURM answers: one that is there already; or one started by the recipe beside the
# project (root, Debian), and stopped at the end. Without either, the tests say that there is none.
set -uo pipefail
recipe=$(dirname "${BASH_SOURCE[0]}")/../../../shared/slurm/slurm.sh

if ! sinfo >/dev/null 2>&1 && [[ -e $recipe && $(id -u) -eq 0 ]]; then
    trap 'bash "$recipe" stop' EXIT
    bash "$recipe" start || echo "SLURM could not be started."
fi
"$@"
