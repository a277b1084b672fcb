"""Calibration loads of simulated feet, cached in files because simulating the presses takes minutes."""

import hashlib
import tempfile
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np

import firmware_interface
from footsense import acquisition, daemon, foot, recording, reference, sim
from footsense.calibration import loads as calibration_loads
from footsense.calibration import session
from footsense.calibration.loads.load_set import LoadSet
from footsense.frames import Vector
from footsense.validation import test_stand_trial
from footsense.validation.code_digest import code_digest

#: All code between a made foot and the loads in its recordings.
_DIGESTED_PACKAGES = (
    *(firmware_interface, acquisition, daemon, foot, recording, reference, sim),
    *(calibration_loads, session),
)


class PressedFoot(NamedTuple):
    """Calibration loads of the training and the test session of one simulated foot.

    Attributes:
        training: Accepted loads of the first session.
        test: Accepted loads of the second, in which it is mounted anew.
        test_true_force_n: True forces of `test` [N], shape (n, 3).
        n_rejected_test_presses: Presses of the second session that are not accepted.
        training_read_duration_s: Time to read the recording of the first session [s].
    """

    training: LoadSet
    test: LoadSet
    test_true_force_n: Vector
    n_rejected_test_presses: int
    training_read_duration_s: float

    @classmethod
    def from_cache_or_simulation(
        cls, batch: test_stand_trial.FootBatch, number: int, every_nth_press: int, cache_folder: Path | None
    ) -> Self:
        """Return the loads of one foot of a batch, from its cache file or newly simulated and cached.

        Args:
            batch: Batch of the foot.
            number: Number of the foot in it.
            every_nth_press: Use one of so many presses.
            cache_folder: Folder of the files; None keeps none.

        Raises:
            FootsenseError: The daemon cannot be started.
        """
        if cache_folder is None:
            return cls._press(batch, number, every_nth_press)
        key = f"{batch} {every_nth_press} {code_digest(*_DIGESTED_PACKAGES)}"
        digest = hashlib.sha256(key.encode()).hexdigest()[:12]
        path = cache_folder / f"{test_stand_trial.foot_name(number)}-{digest}.npz"
        if not path.exists():
            cache_folder.mkdir(parents=True, exist_ok=True)
            part = path.with_suffix(".partial")
            with part.open("wb") as file:
                np.savez(file, **cls._press(batch, number, every_nth_press).arrays())
            part.replace(path)
        with np.load(path) as arrays:
            return cls.from_arrays(arrays)

    def arrays(self) -> dict[str, Any]:
        """Return the loads as arrays by name, for a file."""
        sets = {"training": self.training, "test": self.test}
        fields = {f"{one}.{name}": getattr(sets[one], name) for one in sets for name in LoadSet.__slots__}
        own = {
            name: np.array(getattr(self, name))
            for name in ("n_rejected_test_presses", "training_read_duration_s")
        }
        return {**fields, **own, "test_true_force_n": self.test_true_force_n}

    @classmethod
    def from_arrays(cls, arrays: "np.lib.npyio.NpzFile") -> Self:
        """Return the loads of a foot from the arrays of a file."""
        training, test = (
            LoadSet(**{name: arrays[f"{one}.{name}"] for name in LoadSet.__slots__})
            for one in ("training", "test")
        )
        n_rejected, duration_s = (
            int(arrays["n_rejected_test_presses"]),
            float(arrays["training_read_duration_s"]),
        )
        return cls(training, test, arrays["test_true_force_n"], n_rejected, duration_s)

    @classmethod
    def _press(cls, batch: test_stand_trial.FootBatch, number: int, every_nth_press: int) -> Self:
        """Simulate both sessions of a foot, and return their loads."""
        with tempfile.TemporaryDirectory(prefix="footsense-test-stand-") as folder:
            trial = test_stand_trial.record_sessions_of_foot(
                batch, number, Path(folder), every_nth_press=every_nth_press
            )
        return cls(
            trial.training.loads,
            trial.test.loads,
            trial.test_true_force_n,
            trial.test.rejected.total(),
            trial.training_read_duration_s,
        )
