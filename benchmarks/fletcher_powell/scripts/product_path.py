"""Make the product's package `evopem` importable: a script imports this module before `evopem`."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[3] / "workflow" / "scripts"))
