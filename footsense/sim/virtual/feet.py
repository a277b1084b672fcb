"""Thousands of feet at once, for whoever trains a controller: contact forces in, what the service would publish out.

The chain of the service in arrays, without a bus: every conversion reads the next element of all feet under the load at
its middle, with the converter's noise; after every 18 of board `ad7147`, or four of `fdc1004`, the network estimates
the forces of the time of sending from the last three readings of each element, which are published. Network, response
table and limits of a usable force are the service's.

Left out: rubber's memory, temperature and differences between made feet; faults but for breaks of a cable; the way over
CAN (up to 3 ms of frames for six legs); the search for the element that contradicts the others, so that only overload
makes a foot `DEGRADED`. The error of a baseline is constant, where the service's follows the swing.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_interface.chips import ad7147, fdc1004
from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.estimation.elements import inconsistency_sigma_rel
from footsense.estimation.missing_elements import MAX_OVERLOADED, Imputation
from footsense.estimation.network import READINGS, Network, sensitivity
from footsense.estimation.pipeline import MAX_SIGMA_REL, with_inconsistency
from footsense.foot.gap_contact import CELLS_PER_ELEMENT
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.parameters import KNOWN_EXACTLY, ForceUncertainty, variance_factors
from footsense.foot.response_table import FootResponse, series_basis
from footsense.foot.specimen import Specimen
from footsense.foot.type_folders import foot_type_folder
from footsense.frames import ELEMENTS, IS_USABLE_STATE, Codes, Mask, State, Vector
from footsense.ports import Window
from footsense.sim.scene import Ad7147Effects


class _Scan(NamedTuple):
    """How the service reads six legs with a board, with 40 us of host for each transaction; times as measured of it.

    Attributes:
        step_s: From one conversion to the next [s].
        conversions_per_force: Conversions of each published force.
        send_delay_s: From the middle of a force's last conversion to its sending, on average [s].
        noise_pf: Noise of a conversion [pF rms].
        range_end_pf: Largest capacitance that is read [pF].
        absent_s: How long a foot is absent whose cable breaks for 20 ms [s].
        stale_s: How long its force is then still missing: its readings are too old [s].
    """

    step_s: float
    conversions_per_force: int
    send_delay_s: float
    noise_pf: float
    range_end_pf: float
    absent_s: float
    stale_s: float


#: Of `MISSING_SETS` the empty one.
_NO_SET = np.zeros((1, 1), np.intp)
#: By board: on two buses, and on one at 400 conversions a second. A published force of the service with board `ad7147`
#: has 17.6 conversions of 0.768 ms; here they are 18, two scans, in the same time.
_SCANS = {
    "ad7147": _Scan(
        step_s=13.517e-3 / 18,
        conversions_per_force=18,
        send_delay_s=2.68e-3,
        noise_pf=Ad7147Effects().noise_ff * 1e-3,
        range_end_pf=ad7147.RANGE_END_PF,
        absent_s=23.5e-3,
        stale_s=4.8e-3,
    ),
    "fdc1004": _Scan(
        step_s=2.7476e-3,
        conversions_per_force=4,
        send_delay_s=3.17e-3,
        noise_pf=fdc1004.RATES[400].noise_ff * 1e-3,
        range_end_pf=fdc1004.capacitance_pf(fdc1004.CODE_MAX),
        absent_s=57e-3,
        stale_s=21e-3,
    ),
}
#: Position of each element in the scan.
_POSITION = np.argsort(CONVERSION_ORDERS["lo_shu"])
#: Error of a foot's baseline, and what the service assumes of it and of the noise in a walk [pF].
_BASELINE_ERROR_PF, _BASELINE_SIGMA_PF, _NOISE_SIGMA_PF = 0.3e-3, 0.54e-3, 1.1e-3

Single = NDArray[np.float32]
#: Free closure over the gap from which an element is saturated for certain [1].
_CERTAIN_SATURATION = 1.5


class VirtualForces(NamedTuple):
    """The last published force of each of n feet, as a controller has it at the time of a step.

    Attributes:
        force_n: Ground reaction on the foot, foot frame [N], shape (n, 3); NaN unless usable.
        sigma_n: Standard deviation of each component [N], shape (n, 3); NaN unless usable.
        state: State of each foot, shape (n,), uint8 of `State`.
        usable: Whether its force may be used, shape (n,).
        age_s: Age of the newest reading at the time of the step [s], one number: that of six legs on average.
    """

    force_n: Vector
    sigma_n: Vector
    state: Codes
    usable: Mask
    age_s: float


class VirtualFeet:
    """Feet under given contact forces, in a batch, with the lag, noise and gaps of what the service publishes.

    Args:
        n_feet: Number of feet.
        foot_type: A released foot type, or a folder with a slash in its name.
        board: Electronics of a foot, as in a robot file.
        cable_breaks_per_s: Mean rate at which the cable of a foot breaks for 20 ms; a foot is then without force for
            28 ms, with board `fdc1004` for 78 ms [1/s].
        uncertainty: What the service does not know of the feet, in sigma alone: the feet are as designed.
        seed: Seed of everything random.

    Raises:
        ModelError: The models of the foot type are missing or damaged.
        ValueError: The board is another.

    Example:
        >>> feet = VirtualFeet(2)
        >>> up = np.array([[0.0, 0.0, 1.0]] * 2)
        >>> for t_s in np.arange(0.0, 0.2, 0.01):
        ...     published = feet.step(t_s, up * [[0.8], [0.0]], up)
        >>> published.usable.tolist(), published.force_n[:, 2].round(1).tolist()
        ([True, True], [0.8, 0.0])
    """

    def __init__(
        self,
        n_feet: int,
        foot_type: str = "aoyagi-3x3",
        *,
        board: Literal["ad7147", "fdc1004"] = "ad7147",
        cable_breaks_per_s: float = 0.0,
        uncertainty: ForceUncertainty = KNOWN_EXACTLY,
        seed: int = 0,
    ) -> None:
        if board not in _SCANS:
            raise ValueError(f"board: {' or '.join(_SCANS)}, got {board}")
        self._scan = scan = _SCANS[board]
        folder = foot_type_folder(foot_type)
        path = folder / NETWORK_FILE
        self._response = response = FootResponse.load(folder / "response.npz")
        self._network = Network(path, n_feet)
        self._trained = trained = self._network.card.trained_inputs
        self._design = design = trained.design
        self._specimen = Specimen(response)
        self._imputation = Imputation(trained.moments)
        # What each closure differs from that which the others tell, without overload.
        none = np.zeros((ELEMENTS, ELEMENTS), bool)
        self._residual = self._imputation.residuals(np.eye(ELEMENTS), none, _NO_SET)[:, 0]
        self._max_closure_rel = trained.max_usable_closure_rel(np.full(ELEMENTS, design.gap_um))
        self._random = np.random.default_rng(seed)
        self._break_probability = -np.expm1(-cable_breaks_per_s * scan.conversions_per_force * scan.step_s)
        # Of the cells that each conversion of a scan reads: shape (products, 2 * 3 * cells).
        coefficients = response.closure_coefficients.reshape(2, -1, 3, ELEMENTS, CELLS_PER_ELEMENT)
        coefficients = coefficients.swapaxes(0, 1)
        self._coefficients = [
            coefficients[:, :, :, element].reshape(len(coefficients), -1).astype(np.float32)
            for element in CONVERSION_ORDERS["lo_shu"]
        ]
        unloaded_pf = np.array([design.unloaded_pf])
        self._lowest_z = np.sin(np.radians(response.min_elevation_deg))
        alone = sensitivity(Network(path, 1), 1, trained.moments)
        closure_per_pf = design.plate_distance_um(unloaded_pf) / design.gap_um / unloaded_pf
        self._sigma_n = closure_per_pf * np.hypot(
            _BASELINE_SIGMA_PF * alone.force_sigma_n_per_baseline_error,
            _NOISE_SIGMA_PF * alone.force_sigma_n_per_reading_noise,
        )
        self._across_rel2, self._more_along_rel2 = variance_factors([uncertainty])
        self._closure_rel = np.zeros((n_feet, READINGS, ELEMENTS))
        # Elements with a cell that was closed when they were read last, and those over the converter's range then.
        self._closed, self._over_range = np.zeros((2, n_feet, ELEMENTS), bool)
        self._none_missing = np.zeros((n_feet, ELEMENTS), bool)
        self._baseline_pf = np.full(n_feet, design.unloaded_pf)
        self._force_n = np.zeros((n_feet, 3))
        self._normal = np.tile([0.0, 0.0, 1.0], (n_feet, 1))
        # Until when a foot is absent, and until when its readings are too old.
        self._absent_until_s, self._stale_until_s = np.full((2, n_feet), -np.inf)
        self._published = VirtualForces(
            np.full((n_feet, 3), np.nan),
            np.full((n_feet, 3), np.nan),
            np.zeros(n_feet, np.uint8),
            np.zeros(n_feet, bool),
            np.nan,
        )
        # Each with the middle of its last conversion.
        self._unsent: list[tuple[float, VirtualForces]] = []
        self._start_s = self._t_s = -np.inf
        self._middle_s = np.nan
        self._n_conversions = 0
        self.reset(np.ones(n_feet, bool))

    def reset(self, feet: Mask) -> None:
        """Lift feet off the ground, tared, for a new episode; they have no force until the next is published.

        Args:
            feet: Which, shape (n,).
        """
        self._closure_rel[feet] = self._force_n[feet] = 0.0
        self._over_range[feet] = False
        self._absent_until_s[feet] = self._stale_until_s[feet] = -np.inf
        error_pf = _BASELINE_ERROR_PF * self._random.normal(size=np.count_nonzero(feet))
        self._baseline_pf[feet] = self._design.unloaded_pf + error_pf
        for forces in (self._published, *(forces for _, forces in self._unsent)):
            forces.force_n[feet] = forces.sigma_n[feet] = np.nan
            forces.state[feet], forces.usable[feet] = State.STARTING, False

    def step(self, t_s: float, force_n: Vector, normal: Vector) -> VirtualForces:
        """Return the forces published last by a time, of feet whose contact forces change linearly between the steps.

        Args:
            t_s: Time of the step, after the one before [s].
            force_n: Ground reaction on each foot in its frame (x forward, y left, z along the leg towards the body)
                [N], shape (n, 3); zero in the air.
            normal: Unit normal of the ground, into the foot, same frame and shape; anything for a foot in the air. One
                that leans farther than the response table reaches gives no force.

        Raises:
            ValueError: The time does not advance, a shape is another, or a normal of a loaded foot is no unit vector.
        """
        if not t_s > self._t_s:
            raise ValueError(f"a step at {t_s} s does not follow the one at {self._t_s} s")
        if not force_n.shape == normal.shape == self._force_n.shape:
            raise ValueError(
                f"{len(self._force_n)} feet got forces {force_n.shape} and normals {normal.shape}"
            )
        loaded: Mask = np.asarray(force_n.any(axis=1))
        if not np.allclose(np.square(normal[loaded]).sum(axis=1), 1.0, atol=1e-3):
            raise ValueError("the normal of the ground at a loaded foot has to be a unit vector")
        if self._n_conversions == 0:
            self._start_s, self._t_s, self._force_n = t_s, t_s - self._scan.step_s, force_n
        self._normal = np.where(loaded[:, None], normal, self._normal)
        self._convert_until(t_s, force_n)
        self._t_s, self._force_n = t_s, force_n.copy()
        while self._unsent and self._unsent[0][0] + self._scan.send_delay_s <= t_s:
            self._middle_s, self._published = self._unsent.pop(0)
        return self._published._replace(age_s=round(t_s - self._middle_s, 6))

    def _convert_until(self, t_s: float, force_n: Vector) -> None:
        """Run the conversions up to a time [s], and estimate the forces that are not out of date by then."""
        scan = self._scan
        n_conversions = int((t_s - self._start_s) / scan.step_s) + 1
        if n_conversions == self._n_conversions:
            return
        rows = np.flatnonzero(force_n.any(axis=1) | self._force_n.any(axis=1))
        # Rows below the table are lifted to its edge; `_state` takes their force away.
        normal = self._normal[rows]
        low = normal[:, 2] < self._lowest_z
        across = normal[low, :2]
        normal[low, :2] = (
            across * np.sqrt(1.0 - self._lowest_z**2) / np.linalg.norm(across, axis=1, keepdims=True)
        )
        normal[low, 2] = self._lowest_z
        response = self._response
        basis = series_basis(normal, response.degree, response.fit_elevation_deg).astype(np.float32)
        numbers = range(self._n_conversions, n_conversions)
        # The normal stays the same over the step: each element needs it once, however often it is read.
        per_newton_um = {
            position: (basis @ self._coefficients[position]).reshape(len(rows), 6, CELLS_PER_ELEMENT)
            for position in {number % ELEMENTS for number in numbers}
        }
        for number in numbers:
            middle_s = self._start_s + number * scan.step_s
            share = (middle_s - self._t_s) / (t_s - self._t_s)
            now_n = self._force_n[rows] + share * (force_n - self._force_n)[rows]
            position = number % ELEMENTS
            self._read(CONVERSION_ORDERS["lo_shu"][position], rows, per_newton_um[position], normal, now_n)
            if number % scan.conversions_per_force == scan.conversions_per_force - 1:
                sent_s = middle_s + scan.send_delay_s
                self._break_cables(sent_s)
                if sent_s + scan.conversions_per_force * scan.step_s > t_s:
                    self._unsent.append((middle_s, self._estimate(number, sent_s)))
        self._n_conversions = n_conversions

    def _read(
        self, element: int, rows: NDArray[np.intp], per_newton_um: Single, normal: Vector, force_n: Vector
    ) -> None:
        """Convert an element of all feet, of which those in some rows are loaded."""
        design, scan = self._design, self._scan
        patch_mm2 = np.square(self._response.patch_radius_mm(normal, force_n))
        weights = np.concatenate([force_n, patch_mm2[:, None] * force_n], axis=1).astype(np.float32)
        free_um = (weights[:, None] @ per_newton_um)[:, 0]
        closure_um = np.minimum(free_um, design.gap_um)
        self._closed[:, element] = False
        self._closed[rows, element] = (free_um > design.gap_um).any(axis=1)
        touching = self._closed[rows].any(axis=1) & (
            free_um.mean(axis=1) < _CERTAIN_SATURATION * design.gap_um
        )
        if touching.any():
            cells_um = self._specimen.cell_closures_um(normal[touching], force_n[touching])
            closure_um[touching] = cells_um.reshape(-1, ELEMENTS, CELLS_PER_ELEMENT)[:, element]
        capacitance_pf = np.full(len(self._force_n), design.unloaded_pf)
        capacitance_pf[rows] = design.capacitance_pf(closure_um).mean(axis=1)
        capacitance_pf += scan.noise_pf * self._random.normal(size=capacitance_pf.shape)
        self._over_range[:, element] = capacitance_pf >= scan.range_end_pf
        measured_um = design.closure_um(np.minimum(capacitance_pf, scan.range_end_pf), self._baseline_pf)
        readings = self._closure_rel[:, :, element]
        readings[:, 1:] = readings[:, :-1].copy()
        readings[:, 0] = measured_um / design.gap_um

    def _break_cables(self, now_s: float) -> None:
        broken = self._random.random(len(self._absent_until_s)) < self._break_probability
        # Since the last published force, at any time.
        since_s = (
            self._scan.conversions_per_force
            * self._scan.step_s
            * self._random.random(np.count_nonzero(broken))
        )
        self._absent_until_s[broken] = now_s - since_s + self._scan.absent_s
        self._stale_until_s[broken] = self._absent_until_s[broken] + self._scan.stale_s

    def _estimate(self, number: int, sent_s: float) -> VirtualForces:
        """Return the forces of a time of sending [s] from the readings up to a conversion."""
        trained, scan, newest_rel = self._trained, self._scan, self._closure_rel[:, 0]
        since = np.mod(number - _POSITION, ELEMENTS) + ELEMENTS * np.arange(READINGS)[:, None]
        closure_rel = np.clip(self._closure_rel, trained.closure_rel_min, trained.closure_rel_max)
        age_s = np.broadcast_to(scan.send_delay_s + scan.step_s * since, closure_rel.shape)
        load = self._network.estimate(Window(closure_rel, age_s, self._none_missing))
        force_n, size_n = load.force_n, np.linalg.norm(load.force_n, axis=1)
        max_sigma_n = MAX_SIGMA_REL * trained.max_force_n
        overloaded = self._over_range | (newest_rel > self._max_closure_rel)
        n_overloaded = overloaded.sum(axis=1)
        sigma_n = with_inconsistency(
            np.hypot(load.sigma_n, self._sigma_n), self._inconsistency_rel(overloaded), force_n, max_sigma_n
        )
        out_of_range = (
            (newest_rel < trained.closure_rel_min).any(axis=1)
            | (size_n > trained.max_force_n)
            | (sigma_n > max_sigma_n).any(axis=1)
            | self._force_n.any(axis=1) & (self._normal[:, 2] < self._lowest_z)
        )
        state = np.where(n_overloaded > 0, np.uint8(State.DEGRADED), np.uint8(State.VALID))
        state[out_of_range] = State.OUT_OF_RANGE
        state[sent_s < self._stale_until_s] = State.STALE
        state[n_overloaded > MAX_OVERLOADED] = State.SATURATED
        state[sent_s < self._absent_until_s] = State.ABSENT
        usable = IS_USABLE_STATE[state]
        sigma_n = np.sqrt(
            sigma_n**2 + self._across_rel2 * size_n[:, None] ** 2 + self._more_along_rel2 * force_n**2
        )
        force_n[~usable] = sigma_n[~usable] = np.nan
        return VirtualForces(force_n, sigma_n, state, usable, np.nan)

    def _inconsistency_rel(self, overloaded: Mask) -> Vector:
        """Return the sigma by elements that contradict the others, over the force [1], shape (n,): the service's."""
        newest_rel = self._closure_rel[:, 0]
        worst_rel = np.abs(newest_rel @ self._residual).max(axis=1)
        rows = np.flatnonzero(overloaded.any(axis=1))
        residuals = self._imputation.residuals(newest_rel[rows], overloaded[rows], _NO_SET)
        worst_rel[rows] = np.abs(residuals).max(axis=(1, 2))
        moved_rel = np.abs(np.diff(self._closure_rel, axis=1)).max(axis=1)
        rms_rel = np.sqrt(np.square(newest_rel).mean(axis=1))
        return inconsistency_sigma_rel(worst_rel, rms_rel, np.sort(moved_rel, axis=1)[:, -2])
