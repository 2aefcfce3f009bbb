"""The example's folder is not a package: its files import each other by name."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "adaptive_controller"))
