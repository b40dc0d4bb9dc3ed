"""Makes `tests.sweep.scenes` importable."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))  # the tests are no part of the package
