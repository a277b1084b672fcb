"""A reduced table of the measured insole, for the quick form of the page `real-sensors`.

python -m tests.lab.insole_table FOLDER    writes it anew from the six files of the insole's data
"""

import sys
from pathlib import Path

import numpy as np

from footsense.lab.measured.insole import REDUCED_FILE, read_sessions

FOLDER = Path(__file__).parent / "data"
#: One of so many elements is kept.
_EVERY = 9
_HEADER = """Elements of a capacitive insole in a pressure chamber, of the left insole's data in
github.com/ami-iit/paper_belli_2023_sensors_insole-calibration (Belli et al., Sensors 23, 4501, 2023);
BSD-3, see LICENSE. Means of 32 samples: session, step [ms], pressure [0.34 mbar], 250 - reading [0.1 counts]."""


def main() -> None:
    """Write the table."""
    sessions = read_sessions(Path(sys.argv[1]))
    parts = []
    for number, one in enumerate(sessions.values()):
        pressure = one.pressure_rel * 1e4
        numbers, steps = np.full(len(pressure), number), np.full(len(pressure), one.step_s * 1e3)
        parts.append(np.column_stack([numbers, steps, pressure, 10.0 * one.reading[:, ::_EVERY]]))
    rows = np.vstack(parts)
    formats = ["%d", "%.1f"] + ["%d"] * (rows.shape[1] - 2)
    rounded = np.column_stack([rows[:, :2], rows[:, 2:].round()])
    np.savetxt(FOLDER / "insole" / REDUCED_FILE, rounded, formats, ",", header=_HEADER)


if __name__ == "__main__":
    main()
