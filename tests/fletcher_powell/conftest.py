"""The comparison is no part of the package: its own folder of scripts holds its modules."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks" / "fletcher_powell" / "scripts"))
