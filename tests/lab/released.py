"""The shipped foot type, for tests that need its numbers."""

from pathlib import Path

from footsense.lab.foot_file import FOOT_FILE, load_foot

RELEASED = Path(__file__).parents[2] / "models" / "aoyagi-3x3"
FOOT_DESIGN = load_foot(RELEASED / FOOT_FILE)
