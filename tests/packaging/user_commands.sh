#!/usr/bin/env bash
# What a user runs, as the README prints it: in a fresh copy of the checkout and in the environment
# that `make report` makes from requirements.lock, which has nothing of the development; at last
# in an environment without any extra.
set -euo pipefail
trap 'echo "user_commands.sh: line $LINENO failed" >&2' ERR
cd "$(dirname "$0")/../.."

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
checkout=$work/checkout
mkdir "$checkout" "$work/own"
git ls-files -z | tar --create --null --files-from - | tar --extract --directory "$checkout"

cat >"$work/own/config.yaml" <<'YAML'
defaults:
  recipe: chapter
  split: {discard: 20}
  spectrum: {nfft: 512}
  delay: {orders: [3, 3], nk: [2, 3]}
  orders: {plant: [3, 4], nc: [2, 3], nb: [3, 3]}
  search: {evaluations: 500}
datasets:
  truth: {synthesis: armax, samples: 700}
YAML
cp "$work/own/config.yaml" "$checkout/config.yaml"

say() { printf '\n== %s\n' "$*"; }

say "make report"
make -C "$checkout" report 2>&1 | tee "$work/first.log"
# The first search after an installation says once that it compiles.
[[ $(grep -c "evopem: compiling" "$work/first.log") -eq 1 ]]
[[ -s $checkout/results/truth/report.html ]]
# The lock file and not a developer's environment.
[[ ! -e $checkout/.venv/bin/pytest ]]
"$checkout/.venv/bin/python" -m pip check

cd "$work/own"
. "$checkout/.venv/bin/activate"
say "snakemake --snakefile PATH/Snakefile --directory ."
snakemake --snakefile "$checkout/Snakefile" --directory . 2>&1 | tee "$work/second.log"
[[ -s results/truth/report.html ]]
# The compiled code is kept.
[[ $(grep -c "evopem: compiling" "$work/second.log") -eq 0 ]]
# The same configuration gives the same bytes, in whatever folder.
cmp results/truth/model.json "$checkout/results/truth/model.json"

say "snakemake --report report.zip"
snakemake --snakefile "$checkout/Snakefile" --directory . --report report.zip
python -c "import zipfile; assert zipfile.ZipFile('report.zip').testzip() is None"

say "snakemake (in the checkout)"
cd "$checkout"
snakemake 2>&1 | tee "$work/third.log"
grep --quiet "Nothing to be done" "$work/third.log"

say "pip install PATH"
# With the lock file's versions of what it needs, it installs nothing else than itself.
python -m pip install --quiet --no-deps "$checkout"
cd "$work"
python -c "import evopem; print(evopem.load('own/results/truth/model.json').orders)"
say "evopem export MODEL --c FOLDER"
evopem export own/results/truth/model.json --c code
[[ -s code/truth.c ]]
say "evopem data.csv --input u --output y --rate 100"
mkdir -p recorded
python - <<'PYTHON'
import numpy as np
from evopem.synthesis import armax

recording, _ = armax(seed=1, samples=700)
columns = np.column_stack([recording.input, recording.output])
np.savetxt("recorded/data.csv", columns, delimiter=",", header="u,y", comments="")
PYTHON
cd recorded
evopem data.csv --input u --output y --rate 100 | tee printed.txt
grep --quiet "report  results/data/report.html" printed.txt
[[ -s results/data/report.html ]]
say "evopem a.csv b.csv --input force --output 'acc_*' --rate 100"
mkdir ../blows
cd ../blows
python - <<'PYTHON'
import numpy as np
from scipy.signal import lfilter

generator = np.random.default_rng(1)
for name in ("a.csv", "b.csv"):
    force, noise = generator.standard_normal(400), 0.1 * generator.standard_normal((2, 400))
    acc = np.array([lfilter(b, [1.0, -1.2, 0.8], force) for b in ([0.0, 1.0], [0.0, 0.0, 0.5])])
    columns = np.vstack([force, acc + noise]).T
    np.savetxt(name, columns, delimiter=",", header="force,acc_1,acc_2", comments="")
PYTHON
evopem a.csv b.csv --input force --output 'acc_*' --rate 100 | tee printed.txt
grep --quiet "report  results/a/report.html" printed.txt
[[ -s results/a/modes.csv ]]
cd ../recorded
say "evopem init FOLDER"
evopem init .
grep --quiet "file: data.csv" config.yaml
say "pip install PATH (without any extra)"
deactivate
python3 -m venv "$work/bare"
"$work/bare/bin/python" -m pip install --quiet "$checkout"
cd "$work"
"$work/bare/bin/evopem" --version
mkdir bare_work
cp recorded/data.csv bare_work
cd bare_work
! "$work/bare/bin/evopem" data.csv --input u --output y --rate 100 2>message.txt
grep --quiet 'are not installed; run pip install "evopem\[report\]".$' message.txt
"$work/bare/bin/evopem" init .
"$work/bare/bin/python" - <<'PYTHON'
import sys

import evopem

model = evopem.load("../own/results/truth/model.json")
model.to_scipy(), model.modes()
assert not {"pandas", "matplotlib", "jinja2", "snakemake", "h5py"} & set(sys.modules)
PYTHON
say "Every command succeeded."
