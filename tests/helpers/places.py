"""Where things are that tests need: this repository, the folder beside it, the helpers."""

import os
from pathlib import Path

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared"
HELPERS = Path(__file__).parent
PYTHONPATH = os.pathsep.join(map(str, (HELPERS, ROOT)))
"""For processes that tests start."""
