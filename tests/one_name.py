"""Test files of one name, in folders that are no packages, which pytest cannot collect together."""

import sys
from collections import Counter
from pathlib import Path

files = [p for p in Path(__file__).parent.rglob("test_*.py") if not (p.parent / "__init__.py").exists()]
twice = [name for name, count in Counter(p.name for p in files).items() if count > 1]
sys.exit(f"two test files have one name: {', '.join(twice)}; rename one" if twice else 0)
