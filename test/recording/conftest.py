"""The makers of hostile files belong to a benchmark: its folder's parent has to be on the path."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
