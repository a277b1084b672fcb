"""The chain from contact forces to published forces as a pure function of arrays, which a library may compile.

Each conversion reads the next element of all feet under the load at its middle; a force is estimated from the last 27
readings of a foot at the time at which it is sent. So a step keeps readings alone, and what is published follows from
them and the clock. Numbers are float32 and int32, times whole nanoseconds, as a GPU is fast with.
"""

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.estimation.elements import UNCERTAIN_RESIDUAL, UNCERTAIN_RESIDUAL_REL
from footsense.estimation.missing_elements import MAX_OVERLOADED, Imputation
from footsense.estimation.network import READINGS, Network, sensitivity
from footsense.estimation.pipeline import MAX_SIGMA_REL
from footsense.estimation.settings import RESIDUAL_LIMIT
from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.parameters import KNOWN_EXACTLY, ForceUncertainty, variance_factors
from footsense.foot.response_table import FootResponse
from footsense.foot.type_folders import foot_type_folder
from footsense.frames import ELEMENTS, IS_USABLE_STATE, State
from footsense.sim.uncalibrated import uncertainty_of_uncalibrated
from footsense.sim.virtual.network import Array, ArrayModule, BatchNetwork
from footsense.sim.virtual.response import BatchResponse
from footsense.sim.virtual.scan import SCANS, Board
from footsense.sim.virtual.state import FeetState, VirtualForces
from footsense.sim.virtual.variation import (
    AS_DESIGNED,
    FootDraw,
    Variation,
    draw_feet,
    hashed,
    random_normal,
    uniform,
)

_ORDER = np.array(CONVERSION_ORDERS["lo_shu"])
#: Readings of a window: the last three of each element.
_WINDOW = READINGS * ELEMENTS
#: What the service assumes of the errors of a baseline and of the noise in a walk [pF].
_BASELINE_SIGMA_PF, _NOISE_SIGMA_PF = 0.54e-3, 1.1e-3
#: Random numbers of a foot for one step, at most.
_DRAWS_PER_STEP = 1024
#: Time after which nothing is remembered of a broken cable [ns].
_LONG_AGO_NS = -(10**9)


class FootModel:
    """A foot type with its electronics, in arrays of a library: pure functions from state to state.

    Args:
        foot_type: A released foot type, or a folder with a slash in its name.
        board: Electronics of a foot, as in a robot file.
        cable_breaks_per_s: Mean rate at which the cable of a foot breaks for 20 ms [1/s].
        uncertainty: What the service does not know of the feet, in sigma alone; None for what it does not of feet that
            nobody has calibrated, with tolerances and gains of the variation.
        variation: How the feet differ from the design and from episode to episode.
        xp: Module of the arrays, as `array_api_compat.array_namespace` returns it.
        device: Where they are; None for the library's default.

    Raises:
        ModelError: The models of the foot type are missing or damaged.
        ValueError: The board is another, or the rate is below 0.

    Example:
        >>> import array_api_compat.numpy as xp
        >>> model = FootModel("hexapod-2kg", xp=xp)
        >>> state = model.start(2, seed=0)
        >>> up = xp.asarray([[0.0, 0.0, 1.0]] * 2, dtype=xp.float32)
        >>> for _ in range(5):
        ...     state, published = model.step(state, 0.02, 8.0 * up, up)
        >>> published.force_n[:, 2].round(1).tolist()
        [8.0, 8.0]
    """

    def __init__(
        self,
        foot_type: str = "aoyagi-3x3",
        *,
        board: Board = "ad7147",
        cable_breaks_per_s: float = 0.0,
        uncertainty: ForceUncertainty | None = None,
        variation: Variation = AS_DESIGNED,
        xp: ArrayModule,
        device: Array = None,
    ) -> None:
        if board not in SCANS:
            raise ValueError(f"board: {' or '.join(SCANS)}, got {board}")
        if not 0.0 <= cable_breaks_per_s < math.inf:
            raise ValueError(f"cable_breaks_per_s: a rate, not below 0, got {cable_breaks_per_s}")
        self.scan = scan = SCANS[board]
        folder = foot_type_folder(foot_type)
        response = FootResponse.load(folder / "response.npz")
        self._response = BatchResponse(response, xp, device)
        n_stepped = 2 * _WINDOW
        network = Network(folder / NETWORK_FILE, n_stepped)
        self._trained = trained = network.card.trained_inputs
        self._design = design = trained.design
        self._variation, self._cable_breaks_per_s = variation, cable_breaks_per_s
        self._xp, self._device = xp, device
        self._index_type = xp.__array_namespace_info__().default_dtypes(device=device)["indexing"]
        self._area_pf_um_of_gap = EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2 / design.gap_um
        self._period_ns = ELEMENTS * scan.step_ns
        self._network = BatchNetwork(folder / NETWORK_FILE, 1e-9 * self._period_ns, xp, device)
        known = sensitivity(network, n_stepped, trained.moments)
        closure_per_pf = design.plate_distance_um(np.array(design.unloaded_pf)) / (
            design.gap_um * design.unloaded_pf
        )
        sigma_n = closure_per_pf * np.hypot(
            _BASELINE_SIGMA_PF * known.force_sigma_n_per_baseline_error,
            _NOISE_SIGMA_PF * known.force_sigma_n_per_reading_noise,
        )
        if uncertainty is None:
            differs = variation.gain_rel > 0.0 or variation.tolerances != AS_DESIGNED.tolerances
            made = network, response, n_stepped, variation.tolerances, variation.gain_rel
            uncertainty = uncertainty_of_uncalibrated(*made) if differs else KNOWN_EXACTLY
        across_rel2, more_along_rel2 = variance_factors([uncertainty])
        self._across_rel2, self._more_along_rel2 = float(across_rel2[0, 0]), float(more_along_rel2[0, 0])
        since = np.mod(np.arange(ELEMENTS)[:, None] - np.argsort(_ORDER), ELEMENTS)
        self._of = {
            name: self._array(value)
            for name, value in {
                "sigma_n2": sigma_n[:, None] ** 2,
                "residual": Imputation(trained.moments).residuals.transpose(1, 2, 0),
                "bit": 2 ** np.arange(ELEMENTS)[:, None],
                "least_rel": np.tile(trained.closure_rel_min, READINGS)[:, None],
                "most_rel": np.tile(trained.closure_rel_max, READINGS)[:, None],
                "usable_rel": trained.max_usable_closure_rel(np.full(ELEMENTS, design.gap_um))[:, None],
                "is_usable": IS_USABLE_STATE,
                # By the newest conversion's place in the scan: conversions since each reading of a window.
                "since": (since.T + ELEMENTS * np.arange(READINGS)[:, None, None]).reshape(_WINDOW, ELEMENTS),
                "order": _ORDER,
            }.items()
        }
        longest_ns = scan.send_delay_ns + round(1e9 * variation.delay_s[1])
        self.history = _WINDOW + -(-longest_ns // scan.step_ns) + scan.conversions_per_force

    def _array(self, value: Array) -> Array:
        value = np.asarray(value)
        kinds = {"f": np.float32, "i": np.int32, "b": np.bool_}
        return self._xp.asarray(value.astype(kinds[value.dtype.kind]), device=self._device)

    def start(self, n_feet: int, seed: int | NDArray[np.int_] = 0) -> FeetState:
        """Return feet in the air, tared, which have no force yet; arguments and errors as of `keys`."""
        return self.begin(self.keys(n_feet, seed))

    def keys(self, n_feet: int, seed: int | NDArray[np.int_]) -> Array:
        """Return what makes each foot another, for `begin`, shape (n,), int32.

        Args:
            n_feet: Number of feet.
            seed: Seed of everything random, or one for each environment, shape (environments,), whose feet lie side by
                side: foot j of the k of environment i is number i * k + j.

        Raises:
            ValueError: It is no number of feet, a seed is no integer, or the feet cannot be shared among so many.
        """
        seeds = np.atleast_1d(np.asarray(seed))
        if np.asarray(n_feet).dtype.kind != "i" or n_feet < 1:
            raise ValueError(f"n_feet: an integer above 0, got {n_feet!r}")
        if seeds.dtype.kind not in "iu":
            raise ValueError(f"seed: an integer, or one for each environment, got {seed!r}")
        if n_feet % len(seeds):
            raise ValueError(f"{n_feet} feet cannot be shared among {len(seeds)} environments")
        per_seed = n_feet // len(seeds)
        words = [np.resize(np.arange(per_seed), n_feet)] + [
            np.repeat(seeds >> shift, per_seed) for shift in (0, 32)
        ]
        key = self._array(np.zeros(n_feet, np.int32))
        for word in words:
            key = hashed(key + self._array(word.astype(np.uint32).view(np.int32)))
        return key + 1

    def begin(self, key: Array) -> FeetState:
        """Return feet in the air, tared, which have no force yet, by some of the `keys`."""
        n_feet = key.shape[0]
        none, zero = self._array(np.zeros(n_feet, np.int32)), self._array([0])
        return FeetState(
            change_pf=self._array(np.zeros((self.history, n_feet))),
            force_n=self._array(np.zeros((3, n_feet))),
            normal=self._array(np.tile([[0.0], [0.0], [1.0]], n_feet)),
            n_conversions=none,
            absent_ns=none + _LONG_AGO_NS,
            key=key,
            draw=self._drawn(key),
            number=zero - 1,
            since_ns=zero,
            n_steps=zero,
        )

    def _drawn(self, key: Array) -> FootDraw:
        return draw_feet(self._xp, self._variation, self._design, self.scan.noise_pf, hashed(key))

    def reset(self, state: FeetState, feet: Array) -> FeetState:
        """Return the state after feet were lifted off the ground, tared, and drawn anew, for a new episode.

        Args:
            state: The state.
            feet: Which, shape (n,).
        """
        xp = self._xp
        key = state.key + xp.astype(feet, xp.int32)
        return state._replace(
            change_pf=xp.where(feet, 0.0, state.change_pf),
            force_n=xp.where(feet, 0.0, state.force_n),
            n_conversions=xp.where(feet, 0, state.n_conversions),
            absent_ns=xp.where(feet, _LONG_AGO_NS, state.absent_ns),
            key=key,
            draw=FootDraw(*map(partial(xp.where, feet), self._drawn(key), state.draw)),
        )

    def step(
        self, state: FeetState, step_s: float, force_n: Array, normal: Array
    ) -> tuple[FeetState, VirtualForces]:
        """Return the state after a step, and the forces published last by its end; pure, for `jax.jit` and `lax.scan`.

        Args:
            state: State before it.
            step_s: Length of the step, at most 1 s, a number that is known when the function is compiled [s].
            force_n: Ground reaction on each foot in its frame [N], shape (n, 3); linear in time since the last step.
            normal: Unit normal of the ground, into the foot, same frame and shape; anything for a foot in the air.
        """
        step_ns = round(1e9 * step_s)
        state = self.advance(state, self._array([step_ns]), self.conversions(step_ns), force_n, normal)
        return state, self.published(state)

    def conversions(self, step_ns: int) -> int:
        """Return the most conversions of a step [ns] that change its force."""
        return min(step_ns // self.scan.step_ns + 1, self.history)

    def advance(self, state: FeetState, step_ns: Array, n: int, force_n: Array, normal: Array) -> FeetState:
        """Return the state after a step; as `step`, for a length that a compiled function does not know.

        Args:
            state: State before it.
            step_ns: Its length, at most 10^9 [ns], shape (1,), int32.
            n: `conversions` of that length.
            force_n: As of `step`.
            normal: As of `step`.
        """
        xp, scan_ns, draw, device = self._xp, self.scan.step_ns, state.draw, self._device
        force_n, normal = (xp.astype(part, xp.float32).T for part in (force_n, normal))
        normal = xp.where(xp.any(force_n != 0.0, axis=0), normal, state.normal)
        from_n = xp.where(state.n_steps > 0, state.force_n, force_n)
        elapsed_ns = state.since_ns + step_ns
        n_new = elapsed_ns // scan_ns
        number, since_ns = state.number + n_new, elapsed_ns - n_new * scan_ns
        back = xp.arange(n - 1, -1, -1, dtype=xp.int32, device=device)
        length_ns = xp.astype(step_ns, xp.float32)
        share = xp.clip(1.0 - xp.astype(since_ns + back * scan_ns, xp.float32) / length_ns, 0.0, 1.0)
        element = xp.take(self._of["order"], (number - back) % ELEMENTS, axis=0)
        first = state.n_steps * _DRAWS_PER_STEP
        noise_pf = draw.noise_pf * random_normal(xp, draw.key, first, n)
        read_pf = self._response.change_pf(from_n, force_n, normal, share, element, draw)
        read_pf = read_pf + noise_pf - draw.error_pf
        read_pf = xp.minimum(read_pf, xp.take(self.scan.range_end_pf - draw.tared_pf, element, axis=0))
        # The oldest of them is the newest of the step before, unless the step had one more.
        kept_pf = state.change_pf
        one_more = xp.concat([kept_pf[n:, :], read_pf])
        absent_ns = xp.clip(state.absent_ns - step_ns, min=_LONG_AGO_NS)
        if self._cable_breaks_per_s:
            # Once in a step at most, at any time of it.
            draws = uniform(xp, draw.key, first + n + 1, 2)
            breaks = draws[0, :] < -xp.expm1(-1e-9 * self._cable_breaks_per_s * length_ns)
            found_ns = self.scan.absent_ns - xp.astype(draws[1, :] * length_ns, xp.int32)
            absent_ns = xp.where(breaks, found_ns, absent_ns)
        return state._replace(
            change_pf=xp.where(n_new >= n, one_more, xp.concat([kept_pf[n - 1 :, :], read_pf[1:, :]])),
            force_n=force_n,
            normal=normal,
            n_conversions=xp.clip(state.n_conversions + n_new, 0, 2 * self.history),
            absent_ns=absent_ns,
            number=number,
            since_ns=since_ns,
            n_steps=state.n_steps + 1,
        )

    def published(self, state: FeetState) -> VirtualForces:
        """Return the forces published last, of feet in a state."""
        xp, of, scan, draw = self._xp, self._of, self.scan, state.draw
        # The newest force that is sent, and has come: of a window that ends so many conversions ago.
        early = xp.clip(-((state.since_ns - scan.send_delay_ns - draw.delay_ns) // scan.step_ns), min=0)
        ago = early + (state.number - early + 1) % scan.conversions_per_force
        since = xp.take(of["since"], (state.number - ago) % ELEMENTS, axis=1)
        columns = xp.astype(self.history - 1 - ago - since, self._index_type)
        change_pf = xp.take_along_axis(state.change_pf, columns, axis=0)
        tared_pf = xp.concat([draw.tared_pf] * READINGS)
        closure_rel = self._area_pf_um_of_gap * change_pf / (tared_pf * (tared_pf + change_pf))
        newest_rel = closure_rel[:ELEMENTS, :]
        age_ns = xp.astype(scan.send_delay_ns + scan.step_ns * since[:ELEMENTS, :], xp.float32)
        force_n, sigma_n = self._network.estimate(
            xp.clip(closure_rel, of["least_rel"], of["most_rel"]), age_ns / self._period_ns
        )
        at_end = change_pf[:ELEMENTS, :] >= scan.range_end_pf - draw.tared_pf
        overloaded = at_end | (newest_rel > of["usable_rel"])
        n_overloaded = xp.sum(xp.astype(overloaded, xp.int32), axis=0)
        # As the service's pipeline, its sum of sigma, and its states in the same order.
        max_n, max_sigma_n = self._trained.max_force_n, MAX_SIGMA_REL * self._trained.max_force_n
        square_n2 = xp.sum(force_n * force_n, axis=0)
        variance_n2 = sigma_n * sigma_n + of["sigma_n2"]
        inconsistent_n2 = self._inconsistency_rel(closure_rel, overloaded) ** 2 * square_n2
        variance_n2 = xp.minimum(variance_n2 + inconsistent_n2, xp.clip(variance_n2, min=max_sigma_n**2))
        is_known = (square_n2 <= max_n**2) & xp.all(variance_n2 <= max_sigma_n**2, axis=0)
        sent_ago_ns = state.since_ns + ago * scan.step_ns - scan.send_delay_ns
        absent_ns = state.absent_ns + sent_ago_ns
        states = {
            State.DEGRADED: n_overloaded > 0,
            State.OUT_OF_RANGE: xp.any(newest_rel < of["least_rel"][:ELEMENTS, :], axis=0) | ~is_known,
            State.STALE: (absent_ns > -scan.stale_ns) & (absent_ns <= 0),
            State.SATURATED: n_overloaded > MAX_OVERLOADED,
            State.ABSENT: (absent_ns > 0) & (absent_ns <= scan.absent_ns),
            State.STARTING: state.n_conversions <= ago,
        }
        code = xp.full(n_overloaded.shape, int(State.VALID), dtype=xp.int32, device=self._device)
        for each, holds in states.items():
            code = xp.where(holds, int(each), code)
        usable = xp.take(of["is_usable"], code, axis=0)
        variance_n2 = variance_n2 + self._across_rel2 * square_n2 + self._more_along_rel2 * force_n * force_n
        age_s = 1e-9 * xp.astype(state.since_ns + ago * scan.step_ns, xp.float32)
        return VirtualForces(
            force_n=xp.where(usable, force_n, math.nan).T,
            sigma_n=xp.where(usable, xp.sqrt(variance_n2), math.nan).T,
            state=xp.astype(code, xp.uint8),
            usable=usable,
            age_s=xp.where(state.n_conversions <= ago, math.nan, age_s),
        )

    def _inconsistency_rel(self, closure_rel: Array, overloaded: Array) -> Array:
        """Return the service's sigma by elements that contradict the others, over the force [1], shape (n,)."""
        xp, of = self._xp, self._of
        newest, before, oldest = (closure_rel[k * ELEMENTS : (k + 1) * ELEMENTS, :] for k in range(READINGS))
        pattern = xp.sum(xp.where(overloaded, of["bit"], 0), axis=0)
        residual = xp.sum(xp.take(of["residual"], pattern, axis=2) * newest[None, :, :], axis=1)
        # An overloaded element is closed at least as far as it reads.
        worst = xp.max(xp.where(overloaded, xp.clip(residual, min=0.0), xp.abs(residual)), axis=0)
        moved = xp.maximum(xp.abs(newest - before), xp.abs(before - oldest))
        second = xp.sort(moved, axis=0)[-2, :]
        rms = xp.sqrt(xp.mean(newest * newest, axis=0))
        uncertain = xp.clip(worst - second - UNCERTAIN_RESIDUAL - UNCERTAIN_RESIDUAL_REL * rms, min=0.0)
        return uncertain / xp.clip(rms, min=RESIDUAL_LIMIT)
