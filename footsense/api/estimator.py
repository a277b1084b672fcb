"""The service's estimation on arrays: capacitances to forces, `footsense.Estimator`."""

import math
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from footsense.clock import wall_time_iso
from footsense.daemon.setup.expected_error import UNKNOWN, uncertainty_since
from footsense.errors import ModelError
from footsense.estimation.network import Network, steady_windows
from footsense.estimation.pipeline import Pipeline, pipeline_of
from footsense.estimation.rest import trained_response
from footsense.estimation.settings import EstimationLimits, MountedFeet
from footsense.foot.calibration_files import FootCalibration, read_calibration
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.parameters import ForceUncertainty
from footsense.foot.response_table import FootResponse
from footsense.foot.type_folders import foot_type_folder
from footsense.frames import (
    ELEMENTS,
    IS_USABLE_STATE,
    CapFrame,
    Codes,
    ContactFrame,
    Flag,
    Mask,
    Reading,
    Vector,
)
from footsense.ports import LoadEstimate, Window
from footsense.sim.uncalibrated import uncertainty_by_wear, uncertainty_of_uncalibrated

_DEFAULT_FOOT_TYPE = "aoyagi-3x3"
#: Capacitances of elements in their unit [pF]: those of others are in another unit.
_PLAUSIBLE_PF = (0.5, 50.0)
#: Other units of a capacitance [pF].
_UNITS = {"F": 1e12, "nF": 1e3, "fF": 1e-3, "aF": 1e-6}
#: Scans of the free foot before the first row, where its capacitances are given: a tare takes eight.
_SCANS_OF_A_TARE = 12
#: Rounding of times [s].
_ROUNDING_S = 1e-9
#: Longest scan of any board, and far beyond [s].
_LONGEST_SCAN_S = 2.0


class EstimatedForces(NamedTuple):
    """Forces estimated by `Estimator.run`; leading shape (n,) or (n, feet), as the capacitances had it.

    Attributes:
        t_s: The times that the forces are valid for [s], shape (n,).
        force_n: Ground reaction on the foot in the foot's frame: x forward, y left, z along the leg towards the body
            [N], shape (..., 3); NaN unless usable.
        sigma_n: Standard deviation of each component [N], same shape.
        state: Code of the foot's state, shape (...), uint8 of `State`.
        contact: Whether the foot is in contact with the ground, shape (...); False unless usable.
    """

    t_s: Vector
    force_n: Vector
    sigma_n: Vector
    state: Codes
    contact: Mask

    @property
    def usable(self) -> Mask:
        """Whether the force may be used: the state is VALID or DEGRADED, shape (...)."""
        return np.asarray(IS_USABLE_STATE[self.state])


class Estimator:
    """Estimates the forces of feet from arrays of capacitances, with the stages and the networks of the service.

    The baseline, the reading of each element of the free foot, is the mean of the first eight scans: the feet have to
    hang free and still in them, within 3 % of the capacitance of the calibration, or of the design. Else, and until
    then, the state is TARING or NO_BASELINE and there is no force. With `unloaded_pf` the baseline is that from the
    first row on. As in the service, it then follows slow drift while a foot hangs in the air, and the force of a foot
    that stands still is refined, one round of one foot in each row. Feet without a calibration are taken as designed,
    without stray capacitance.

    Of a recorded walk these are the forces of the service, bit for bit while all readings are in range; so is sigma,
    which is brought up to date every tenth of a second, if the times are those of the service's clock.

    Args:
        foot_type: A released foot type: `aoyagi-3x3`, `hexapod-2kg` or `quadruped-12kg`; or, with a slash, the folder
            of another. None for that of the calibration, and without one for `aoyagi-3x3`.
        calibration: Folder of a foot's calibration, or a file in it, as `footsense test-stand calibrate` writes it: the
            readings are then of this foot. Of a robot take an `Estimator` for each leg.
        unloaded_pf: Reading of each element of the free foot [pF], shape (9,), or (feet, 9); None to take the first
            scans.

    Attributes:
        foot_type: Name of the foot type.

    Raises:
        ModelError: There is no such foot type or calibration, or the calibration is damaged or of another foot type.
        ValueError: `unloaded_pf` has another shape, or is not in pF.

    Example::

        walk = footsense.read("walk.mcap")
        forces = footsense.Estimator("aoyagi-3x3").run(walk.capacitance_pf, walk.t_s, walk.reading_t_s)
    """

    def __init__(
        self,
        foot_type: str | None = None,
        *,
        calibration: str | Path | None = None,
        unloaded_pf: ArrayLike | None = None,
    ) -> None:
        self._calibration = None if calibration is None else _read_calibration(Path(calibration), foot_type)
        self._network = (
            foot_type_folder(foot_type or _DEFAULT_FOOT_TYPE) / NETWORK_FILE
            if self._calibration is None
            else self._calibration.network
        )
        network = Network(self._network, 1)
        self.foot_type = network.card.foot_type
        self._response = _response(foot_type or self.foot_type, network)
        self._unloaded_pf = None if unloaded_pf is None else _capacitances(unloaded_pf, "unloaded_pf")

    def run(
        self, capacitance_pf: ArrayLike, t_s: ArrayLike, reading_t_s: ArrayLike | None = None
    ) -> EstimatedForces:
        """Estimate the force of each foot in each row of readings.

        Args:
            capacitance_pf: Readings of the elements [pF], shape (n, 9) of one foot, or (n, feet, 9); element
                3 * row + column, row 0 the most forward, column 0 the leftmost. NaN where an element gave none: it
                counts as open.
            t_s: Times that the forces are to be valid for [s], shape (n,), increasing.
            reading_t_s: Time of each reading [s], of the shape of the readings, none later than its row of `t_s`; an
                element with the time of the row before was not read again. The force is extrapolated from the last
                three readings of each element. None if all elements of a row were read at `t_s`: then each row gives
                its force by itself, but for the fit at rest.

        Returns:
            The forces, their standard deviations and the states.

        Raises:
            ValueError: Shapes do not fit, times are not in order, readings are not in pF, or are those of a scanned
                walk, one new in each row, without `reading_t_s`.
        """
        pf, now_s = _capacitances(capacitance_pf, "capacitance_pf"), np.asarray(t_s, np.float64)
        if pf.ndim not in {2, 3}:
            raise ValueError(f"capacitance_pf: shape (n, 9) or (n, feet, 9), got {pf.shape}")
        if now_s.shape != pf.shape[:1]:
            raise ValueError(
                f"t_s: a time for each of the {len(pf)} rows of readings, got shape {now_s.shape}"
            )
        if not (np.diff(now_s) > 0.0).all():
            raise ValueError("t_s: the times do not increase from row to row, or one is not finite")
        feet_pf = pf.reshape(len(pf), -1, ELEMENTS)
        if reading_t_s is None:
            _refuse_scanned_walk(feet_pf)
            read_s = np.broadcast_to(now_s[:, None, None], feet_pf.shape)
        else:
            read_s = _reading_times(reading_t_s, pf, now_s).reshape(feet_pf.shape)
        frames = self._process(feet_pf, now_s, read_s, is_scanned=reading_t_s is not None)
        force_n, sigma_n, state, flags = (
            np.array([getattr(frame, name) for frame in frames]).reshape(*pf.shape[:-1], *shape)
            for name, shape in {"force_n": (3,), "sigma_n": (3,), "state": (), "flags": ()}.items()
        )
        contact = (flags & Flag.CONTACT != 0) & IS_USABLE_STATE[state]
        return EstimatedForces(now_s, force_n, sigma_n, state, contact)

    def _process(
        self, capacitance_pf: Vector, t_s: Vector, reading_t_s: Vector, *, is_scanned: bool
    ) -> list[ContactFrame]:
        """Return the forces of each row; the readings have the shape (n, feet, 9)."""
        n, n_feet = capacitance_pf.shape[:2]
        scan_s, n_before = _scan_s(reading_t_s), 0
        if self._unloaded_pf is not None:
            # Scans of the free foot before the first row: their mean is the baseline.
            n_before = _SCANS_OF_A_TARE
            free_pf = np.broadcast_to(self._unloaded_pf, capacitance_pf.shape[1:])
            before_s = t_s[0] - scan_s * np.arange(n_before, 0, -1.0)
            t_s = np.concatenate([before_s, t_s])
            of_elements_s = np.broadcast_to(before_s[:, None, None], (n_before, n_feet, ELEMENTS))
            reading_t_s = np.concatenate([of_elements_s, reading_t_s])
            capacitance_pf = np.concatenate([np.broadcast_to(free_pf, of_elements_s.shape), capacitance_pf])
        # The time 0 stands for no reading. Shifted by whole seconds: what is done ten times a second is done when the
        # service does it.
        start_s = math.floor(t_s[0]) - 1.0
        has_time = np.isfinite(reading_t_s)
        t_ns = np.where(has_time, np.rint((reading_t_s - start_s) * 1e9), 0.0).astype(np.int64)
        now_ns = np.rint((t_s - start_s) * 1e9).astype(np.int64)
        # An element without a number has lost its electrode; without a time it has not been read yet.
        is_open = np.isnan(capacitance_pf) & has_time
        reading = np.where(is_open, Reading.UNDER_RANGE, Reading.OK).astype(np.uint8)
        pipeline = self._pipeline(n_feet, round(scan_s * 1e9), is_scanned=is_scanned)
        frames = [
            pipeline.process(CapFrame(row, t_ns[row], capacitance_pf[row], reading[row]), int(now_ns[row]))[0]
            for row in range(n_before + n)
        ]
        return frames[n_before:]

    def _pipeline(self, n_feet: int, scan_ns: int, *, is_scanned: bool) -> Pipeline:
        network, known = Network(self._network, n_feet), self._calibration
        feet = MountedFeet.of(
            network.card.trained_inputs.design,
            [known.parameters if known else None] * n_feet,
            reading_pf=np.nan if self._unloaded_pf is None else self._unloaded_pf,
            uncertainty=[self._uncertainty(network, n_feet)] * n_feet,
            calibrated_at_c=[known.calibrated_at_c if known else None] * n_feet,
        )
        # An array says of no reading that it is over the range.
        limits = EstimationLimits(scan_ns=scan_ns, range_end_pf=math.inf)
        estimator = None if is_scanned else SteadyEstimator(network)
        return pipeline_of(network, feet, limits, self._response, estimator=estimator)

    def _uncertainty(self, network: Network, n_feet: int) -> ForceUncertainty:
        """Return what nobody knows of a foot."""
        if self._calibration is not None:
            wear = uncertainty_by_wear(network, self._response, n_feet)
            return uncertainty_since(self._calibration, wall_time_iso(), wear)
        if self._response is None:
            return UNKNOWN
        return uncertainty_of_uncalibrated(network, self._response, n_feet)


class SteadyEstimator:
    """Estimator of feet whose elements are all read at one time: the load of the newest readings alone.

    Args:
        network: The network; its training had the elements read one after the other.
    """

    def __init__(self, network: Network) -> None:
        self._network = network

    def estimate(self, window: Window) -> LoadEstimate:
        """Return the load of the newest readings of each foot, as if they had not changed for three scans."""
        return self._network.estimate(steady_windows(window.closure_rel[:, 0], window.missing))


def _response(foot_type: str, network: Network) -> FootResponse | None:
    """Return the response table of a foot type; None, and a warning why, where there is none or another."""
    try:
        return trained_response(foot_type_folder(foot_type), network)
    except ModelError as error:
        warnings.warn(f"loads at rest are not refined: {error}", stacklevel=3)
        return None


def _read_calibration(path: Path, foot_type: str | None) -> FootCalibration:
    """Return the calibration in a folder, or in that of a file; of any foot type for None."""
    name = (
        None if foot_type is None else Network(foot_type_folder(foot_type) / NETWORK_FILE, 1).card.foot_type
    )
    return read_calibration(path.parent if path.is_file() else path, name)


def _capacitances(values: ArrayLike, name: str) -> Vector:
    """Return capacitances as an array of shape (..., 9).

    Raises:
        ValueError: They have another shape, no finite number, or another unit than pF.
    """
    pf = np.asarray(values, np.float64)
    if pf.ndim and not pf.size:
        raise ValueError(f"{name}: has no readings; got shape {pf.shape}")
    if pf.ndim == 0 or pf.shape[-1] != ELEMENTS:
        raise ValueError(f"{name}: its last axis has the nine elements of a foot; got shape {pf.shape}")
    if not np.isfinite(pf).any():
        raise ValueError(f"{name}: has no finite number")
    typical_pf = float(np.nanmedian(np.where(np.isfinite(pf), pf, np.nan)))
    least_pf, most_pf = _PLAUSIBLE_PF
    if not least_pf <= typical_pf <= most_pf:
        units = [unit for unit, in_pf in _UNITS.items() if least_pf <= typical_pf * in_pf <= most_pf]
        seems = f", which looks like {units[0]}" if units else ""
        raise ValueError(f"{name}: is in pF, about 5 pF of an element; the median is {typical_pf:.3g}{seems}")
    return pf


def _reading_times(values: ArrayLike, capacitance_pf: Vector, t_s: Vector) -> Vector:
    """Return the times of the readings [s] as an array.

    Raises:
        ValueError: They have another shape than the readings, or are out of order.
    """
    read_s = np.asarray(values, np.float64)
    if read_s.shape != capacitance_pf.shape:
        raise ValueError(
            f"reading_t_s: a time for each reading, shape {capacitance_pf.shape}, got {read_s.shape}"
        )
    now_s = t_s.reshape(-1, *[1] * (read_s.ndim - 1))
    if (read_s > now_s + _ROUNDING_S).any():
        raise ValueError("reading_t_s: a reading is later than the time of its row in t_s")
    if (np.diff(read_s, axis=0) < 0.0).any():
        raise ValueError("reading_t_s: the times of an element go back")
    if (scan_s := _scan_s(read_s)) > _LONGEST_SCAN_S:
        raise ValueError(
            f"reading_t_s: {scan_s:g} s from one reading of an element to its next; are they in ms?"
        )
    return read_s


def _refuse_scanned_walk(capacitance_pf: Vector) -> None:
    """Raise an error for the readings of a scanned walk, of which each row has a new element of each foot.

    Raises:
        ValueError: They are.
    """
    n_changed = (np.abs(np.diff(capacitance_pf, axis=0)) > 0.0).sum(axis=-1)
    if len(n_changed) > ELEMENTS and np.median(n_changed) == 1:
        raise ValueError(
            "capacitance_pf: has one new reading in each row, as a Recording has; give their times too: "
            "run(walk.capacitance_pf, walk.t_s, walk.reading_t_s)"
        )


def _scan_s(reading_t_s: Vector) -> float:
    """Return the usual time from one reading of an element to its next [s]."""
    steps_s = np.diff(reading_t_s, axis=0)
    steps_s = steps_s[steps_s > 0.0]
    return float(np.median(steps_s)) if steps_s.size else 1.0
