"""Window of each element's last three readings, and the neural network that gets it, run by ONNX Runtime.

No other file imports that library. One call for all legs, one thread, no spinning: a spinning worker would take a core
from the rest of the robot, and a second thread costs more than this network's microseconds.
"""

from collections.abc import Sequence
from operator import methodcaller
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnxruntime as ort

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.errors import ModelError
from footsense.estimation.missing_elements import trimmed_means
from footsense.estimation.settings import (
    CLEAR_MOTION_REL,
    CORRELATED_S,
    RESIDUAL_LIMIT,
    SMALL_SHARE,
    UNEVEN_DRIFT_SHARE,
    Sensitivity,
)
from footsense.foot.network_card import INPUTS, METADATA_KEY, OUTPUTS, Signal, read_card, verified_sha256
from footsense.frames import ELEMENTS, Mask, Stamps, Vector
from footsense.ports import LoadEstimate, LoadEstimator, Window
from footsense.regular_file import read_regular

#: Shares of the trained range of the inputs at which a network is tested before use [1].
_TEST_CLOSURE_LEVELS_REL = (0.0, 0.5, 1.0)

#: Severity of ONNX Runtime.
_FATAL = 4
#: Readings of an element in a window.
READINGS = 3
#: Time within which two readings of an element always follow on one another [ns]: of a fast scan, legs that are set up
#: on its bus delay two conversions.
_ALWAYS_CONSECUTIVE_NS = round(2e9 * CORRELATED_S)

#: Usual ages of each element's three readings at 400 conversions a second [s], shape (3, 9): those at the end of a scan
#: in the order of the magic square.
_CONVERSIONS_AGO = ELEMENTS - 1 - np.argsort(CONVERSION_ORDERS["lo_shu"]) + ELEMENTS * np.arange(3)[:, None]
STEADY_AGES_S: Vector = np.asarray(2.7e-3 * (1.0 + _CONVERSIONS_AGO), np.float64)

#: Largest closures of the loads at which the sensitivity is taken [1], and the step of the differences [1].
_CLOSURE_LEVELS_REL = (RESIDUAL_LIMIT, SMALL_SHARE)
DIFFERENCE_STEP_REL = float(np.sqrt(np.finfo(np.float32).eps))


class Readings(NamedTuple):
    """Last three readings of every element of all legs, newest first.

    Attributes:
        plate_distance_rel: Plate distances over the gap [1], shape (3, legs, 9), NaN where there is none.
        t_ns: Middle of each conversion [ns], same shape; 0 where there is none.
        is_consecutive: Elements whose newest two readings follow on one another, shape (legs, elements).
        newest_ns: Time of each leg's newest reading [ns], shape (legs,); 0 without one.
        oldest_of_newest_ns: Time of the oldest of the newest readings of each leg's whole elements [ns], shape (legs,).
        changes_rel: Changes of the plate distances from one reading to the next [1], shape (2, legs, 9).
        second_largest_motion_rel: Second largest change of an element from one reading to the next [1], shape (legs,).
    """

    plate_distance_rel: Vector
    t_ns: Stamps
    is_consecutive: Mask
    newest_ns: Stamps
    oldest_of_newest_ns: Stamps
    changes_rel: Vector
    second_largest_motion_rel: Vector


class ReadingWindow:
    """Buffer of the last three readings of every element.

    Args:
        n_legs: Legs of a frame.
        scan_ns: Time of a scan [ns].
    """

    def __init__(self, n_legs: int, scan_ns: int) -> None:
        # Distances and times in one memory, whose newer and older readings move together, those of a time side by side.
        kept = np.zeros((2, READINGS, n_legs, ELEMENTS), np.int64)
        self._newer, self._older = kept[:, :-1], kept[:, 1:]
        self._distance_rel, self._t_ns = kept[0].view(np.float64), kept[1]
        self._distance_rel[...] = np.nan
        # Less than two scans: after a stall, older readings are not mixed with newer ones. A slow host takes half more.
        self._longest_ns = np.array(max(round((2.0 - SMALL_SHARE) * scan_ns), _ALWAYS_CONSECUTIVE_NS))

    def add(self, plate_distance_rel: Vector, t_ns: Stamps) -> Readings:
        """Add the new readings of a frame; return the last three readings of every element.

        If only the newest two readings of an element follow on one another, the second stands for the third as well:
        over random gaits no error exceeds 7 sigma then, and a third on a line with the two gives up to 370 sigma.

        Args:
            plate_distance_rel: Plate distances over the gap [1], shape (legs, elements), NaN where there is none.
            t_ns: Middle of each element's conversion [ns], same shape.
        """
        kept_rel, kept_ns = self._distance_rel, self._t_ns
        np.copyto(self._older, self._newer, where=t_ns != kept_ns[0])
        kept_rel[0], kept_ns[0] = plate_distance_rel, t_ns
        steps_ns = kept_ns[:2] - kept_ns[1:]
        steps_rel = kept_rel[:2] - kept_rel[1:]
        # A NaN makes the difference one.
        in_order = (steps_ns > 0) & (steps_ns <= self._longest_ns) & np.isfinite(steps_rel)
        all_in_order = np.count_nonzero(in_order) == in_order.size
        moved_rel = np.abs(steps_rel)
        if not all_in_order:
            moved_rel[~in_order] = 0.0
        moved_rel = np.maximum(moved_rel[0], moved_rel[1])
        moved_rel.partition(ELEMENTS - 2, axis=1)
        # One element that moved far alone: a load moves several.
        for second_rel, largest_rel in moved_rel[:, ELEMENTS - 2 :].tolist():
            if largest_rel > CLEAR_MOTION_REL + 3.0 * second_rel:
                _replace_spikes(kept_rel)
                break
        of_whole_ns, newest_ns = t_ns, np.maximum.reduce(t_ns, axis=1)
        if not all_in_order:
            kept_rel, kept_ns, alone = kept_rel.copy(), kept_ns.copy(), ~in_order[1]
            np.copyto(kept_rel[2], kept_rel[1], where=alone)
            np.copyto(kept_ns[2], kept_ns[1] - steps_ns[0], where=alone)
            of_whole_ns = np.where(in_order[0], t_ns, newest_ns[:, None])
        return Readings(
            kept_rel,
            kept_ns,
            in_order[0],
            newest_ns,
            np.minimum.reduce(of_whole_ns, axis=1),
            steps_rel,
            moved_rel[:, ELEMENTS - 2],
        )

    def discard_newest(self, elements: Mask) -> None:
        """Discard the newest reading of each element in a mask, shape (legs, elements)."""
        self._distance_rel[0][elements] = np.nan


def _replace_spikes(plate_distance_rel: Vector) -> None:
    """Replace, in place, a middle reading that is far from its two agreeing neighbours by their mean.

    Args:
        plate_distance_rel: The readings of each element, newest first [1], shape (3, legs, 9).
    """
    newest, middle, oldest = plate_distance_rel
    mean_rel = (newest + oldest) / 2.0
    spike_rel = np.abs(middle - mean_rel)
    wrong = (spike_rel > CLEAR_MOTION_REL) & (np.abs(newest - oldest) < SMALL_SHARE * spike_rel)
    np.copyto(middle, mean_rel, where=wrong)


def steady_windows(closure_rel: Vector, missing: Mask | None = None) -> Window:
    """Return the network inputs of feet whose gap closures have been constant for three scans.

    Args:
        closure_rel: Closures over the gap, missing ones imputed [1], shape (rows, elements).
        missing: The imputed ones, same shape; None for none.
    """
    return Window(
        np.repeat(closure_rel[:, None], 3, axis=1),
        np.broadcast_to(STEADY_AGES_S, (len(closure_rel), *STEADY_AGES_S.shape)),
        np.zeros(closure_rel.shape, bool) if missing is None else missing,
    )


class Network:
    """Loaded neural network for a fixed number of feet (rows).

    Args:
        path: ONNX file with a card inside.
        n_rows: Rows of every call.

    Attributes:
        card: Card of the network.
        sha256: Hash of the file without its checksum trailer, which identifies the network in recordings.

    Raises:
        ModelError: The file is missing, damaged, or no ONNX network; its card does not fit; or it gives no force inside
            its trained range.
    """

    def __init__(self, path: Path, n_rows: int) -> None:
        content = _read_file(path)
        self.sha256 = verified_sha256(content, str(path))
        options = ort.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.execution_mode = ort.ExecutionMode.ORT_SEQUENTIAL
        options.add_session_config_entry("session.intra_op.allow_spinning", "0")
        # Only fatal messages: errors come as exceptions, and warnings do not belong in the robot's journal.
        options.log_severity_level = _FATAL
        try:
            self._session = ort.InferenceSession(
                content, options, providers=["CPUExecutionProvider"], enable_fallback=0
            )
            text = self._session.get_modelmeta().custom_metadata_map.get(METADATA_KEY)
            # Here, as a name that is no UTF-8 raises when it is read.
            inputs, outputs = (
                [(value.name, value.type, value.shape) for value in values]
                for values in (self._session.get_inputs(), self._session.get_outputs())
            )
        except Exception as error:  # the library raises a dozen types without a common base
            raise ModelError(f"{path}: not a readable ONNX network ({_error_line(error)})") from error
        # Shapes first: read_card would only say that a card of another shape does not fit.
        if text is not None:
            _check_shapes(path, "input", inputs, INPUTS)
            _check_shapes(path, "output", outputs, OUTPUTS)
        self.card = read_card(text, str(path))
        # Bound to the session: a call copies and allocates nothing.
        self._binding = self._session.io_binding()
        self._in = [np.zeros((n_rows, signal.width), np.float32) for signal in INPUTS]
        self._out = [np.zeros((n_rows, signal.width), np.float32) for signal in OUTPUTS]
        for signal, array in zip(INPUTS, self._in, strict=True):
            self._binding.bind_ortvalue_input(signal.name, ort.OrtValue.ortvalue_from_numpy(array))
        for signal, array in zip(OUTPUTS, self._out, strict=True):
            self._binding.bind_ortvalue_output(signal.name, ort.OrtValue.ortvalue_from_numpy(array))
        self._run_test_inference(path)

    def estimate(self, window: Window) -> LoadEstimate:
        """Return the estimated load of every row of the window."""
        for array, values in zip(self._in, window, strict=True):
            array[...] = values.reshape(array.shape)
        self._session.run_with_iobinding(self._binding)
        return LoadEstimate(*map(methodcaller("astype", np.float64), self._out))

    def _run_test_inference(self, path: Path) -> None:
        """Run the network over the trained range as a check; the first run allocates its memory.

        Raises:
            ModelError: The network cannot be run for so many rows, or gives a value that is not finite.
        """
        low, high = np.array(self.card.closure_rel_min), np.array(self.card.closure_rel_max)
        n_rows = len(self._in[0])
        for share in _TEST_CLOSURE_LEVELS_REL:
            closure_rel = low + share * (high - low)
            try:
                load = self.estimate(steady_windows(np.tile(closure_rel, (n_rows, 1))))
            except Exception as error:  # as above
                raise ModelError(f"{path}: cannot be run for {n_rows} legs ({_error_line(error)})") from error
            if not all(np.isfinite(part).all() for part in load):
                raise ModelError(
                    f"{path}: gives {load.force_n[0].tolist()} N, sigma {load.sigma_n[0].tolist()} N inside its "
                    "trained range; its weights are corrupt"
                )


def _jacobian_n(estimator: LoadEstimator, n_rows: int, closure_rel: Vector) -> Vector:
    """Return the derivative of the force by each reading's closure [N], shape (3, 9, 3), by central differences.

    The first axis has the readings of an element, newest first.

    Args:
        estimator: The network.
        n_rows: Rows that it estimates at once.
        closure_rel: Closures over the gap at which it is taken [1], shape (elements,).
    """
    steady = steady_windows(np.tile(closure_rel, (n_rows, 1)))
    # Each row of a batch has another reading changed, up or down.
    reading = np.repeat(np.arange(READINGS * ELEMENTS), 2)
    step_rel = np.tile([DIFFERENCE_STEP_REL, -DIFFERENCE_STEP_REL], READINGS * ELEMENTS)
    forces_n: Vector = np.empty((len(reading), 3))
    for start in range(0, len(reading), n_rows):
        part = slice(start, start + n_rows)
        stepped_rel = steady.closure_rel.copy()
        stepped_rel.reshape(n_rows, -1)[np.arange(len(reading[part])), reading[part]] += step_rel[part]
        load = estimator.estimate(steady._replace(closure_rel=stepped_rel))
        forces_n[part] = load.force_n[: len(reading[part])]
    up_n, down_n = forces_n.reshape(READINGS, ELEMENTS, 2, 3).transpose(2, 0, 1, 3)
    return (up_n - down_n) / (2 * DIFFERENCE_STEP_REL)


def sensitivity(estimator: LoadEstimator, n_rows: int, moments: Vector) -> Sensitivity:
    """Return the sensitivity at light and heavy loads, for even closures and for the principal pattern.

    Args:
        estimator: The network.
        n_rows: Rows that it estimates at once.
        moments: Second moments of the closures of its loads, shape (elements, elements).
    """
    axes, directions = np.linalg.eigh(moments)
    # The most common closure pattern: the principal component, its largest entry 1.
    stance_rel = np.abs(directions[:, axes.argmax()])
    stance_rel /= stance_rel.max()
    of_readings_n = np.array(
        [
            _jacobian_n(estimator, n_rows, level * pattern)
            for level in _CLOSURE_LEVELS_REL
            for pattern in (stance_rel, np.ones(len(moments)))
        ]
    )
    of_elements_n = of_readings_n.sum(axis=1)
    errors_n = np.hypot(of_elements_n.sum(axis=1), UNEVEN_DRIFT_SHARE * np.linalg.norm(of_elements_n, axis=1))
    stance_rel = _CLOSURE_LEVELS_REL[-1] * stance_rel
    rows = np.tile(stance_rel, (n_rows, 1))
    force_n = estimator.estimate(steady_windows(rows)).force_n
    return Sensitivity(
        load_n_per_mean_closure=float(force_n[0, 2] / trimmed_means(stance_rel[None])[0]),
        force_sigma_n_per_baseline_error=errors_n.max(axis=0),
        force_n_per_closure=of_elements_n,
        # The mean over the loads: the network weighs the same noise up to six times more at one than at another.
        force_sigma_n_per_reading_noise=np.sqrt((of_readings_n**2).sum(axis=(1, 2)).mean(axis=0)),
    )


def _read_file(path: Path) -> bytes:
    """Return the content of a network file.

    Raises:
        ModelError: The file is missing, cannot be read, or is too large.
    """
    try:
        return read_regular(path)
    except FileNotFoundError as error:
        raise ModelError(f"{path}: no such network ({error.strerror})") from error
    except OSError as error:
        raise ModelError(f"{path}: cannot be read: {error.strerror}") from error


def _check_shapes(
    path: Path, kind: str, values: Sequence[tuple[str, str, Sequence[Any]]], needed: Sequence[Signal]
) -> None:
    """Raise an error unless names, types and shapes of the inputs or outputs are the expected ones.

    Raises:
        ModelError: They are others than the daemon's.
    """
    found = [(name, dtype, shape[1:]) for name, dtype, shape in values]
    if found != [(signal.name, "tensor(float)", [signal.width]) for signal in needed]:
        shown = ", ".join(f"{name} [{', '.join(map(str, shape))}] {dtype}" for name, dtype, shape in values)
        wanted = ", ".join(f"{signal.name} [n, {signal.width}]" for signal in needed)
        raise ModelError(f"{path}: its {kind}s are {shown or 'missing'}; the daemon needs float32 {wanted}")


def _error_line(error: Exception) -> str:
    """Return the first line of a library error's message, or the name of its type."""
    return str(error).strip().partition("\n")[0] or type(error).__name__
