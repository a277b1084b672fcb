"""The chain from contact forces to published forces as a pure function of arrays, which a library may trace and compile.

Each conversion reads the next element of all feet under the load at its middle; a force is estimated from the last 27
readings of a foot at the time at which it is sent. So a step keeps readings alone, and what is published follows from
them and the clock. Numbers are float32 and int32, times whole nanoseconds, as a GPU is fast with.

A gap that closes is a complementarity problem of one foot alone: those few readings are solved on the host, exactly.
"""

import functools
import math
import operator
import sys
from typing import Any, Literal, NamedTuple

import numpy as np
from array_api_compat import is_jax_array, is_lazy_array, is_torch_array, to_device
from numpy.typing import NDArray

from firmware_interface.chips import ad7147, fdc1004
from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.estimation.elements import (
    RESIDUAL_LIMIT,
    UNCERTAIN_RESIDUAL,
    UNCERTAIN_RESIDUAL_REL,
)
from footsense.estimation.missing_elements import MAX_OVERLOADED, OVERLOAD_RESIDUAL_REL, Imputation
from footsense.estimation.network import READINGS, Network, sensitivity
from footsense.estimation.pipeline import MAX_SIGMA_REL
from footsense.foot.capacitor import EPS0_PF_UM_PER_MM2
from footsense.foot.directions import normalized
from footsense.foot.gap_contact import CELLS_PER_ELEMENT as _CELLS
from footsense.foot.gap_contact import N_CELLS, solve_contact_lcp
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.parameters import KNOWN_EXACTLY, ForceUncertainty, variance_factors
from footsense.foot.response_table import FootResponse
from footsense.foot.type_folders import foot_type_folder
from footsense.frames import ELEMENTS, IS_USABLE_STATE, Mask, State
from footsense.sim.scene import Ad7147Effects
from footsense.sim.virtual.network import Array, ArrayModule, BatchNetwork
from footsense.sim.virtual.variation import AS_DESIGNED, FootDraw, Variation, draw_feet, hashed, random_normal, uniform


class _Scan(NamedTuple):
    """How the service reads six legs with a board, with 40 us of host for each transaction; times as measured of it.

    Attributes:
        step_ns: From one conversion to the next [ns].
        conversions_per_force: Conversions of each published force.
        send_delay_ns: From the middle of a force's last conversion to its sending, on average [ns].
        noise_pf: Noise of a conversion [pF rms].
        range_end_pf: Largest capacitance that is read [pF].
        absent_ns: How long a foot is absent whose cable breaks for 20 ms [ns].
        stale_ns: How long its force is then still missing: its readings are too old [ns].
    """

    step_ns: int
    conversions_per_force: int
    send_delay_ns: int
    noise_pf: float
    range_end_pf: float
    absent_ns: int
    stale_ns: int


Board = Literal["ad7147", "fdc1004"]
#: By board: on two buses, and on one at 400 conversions a second. A published force of the service with board `ad7147`
#: has 17.6 conversions of 0.768 ms; here they are 18, two scans, in the same time.
SCANS = {
    "ad7147": _Scan(
        step_ns=round(13.517e6 / 18),
        conversions_per_force=18,
        send_delay_ns=2_680_000,
        noise_pf=Ad7147Effects().noise_ff * 1e-3,
        range_end_pf=ad7147.RANGE_END_PF,
        absent_ns=23_500_000,
        stale_ns=4_800_000,
    ),
    "fdc1004": _Scan(
        step_ns=2_747_600,
        conversions_per_force=4,
        send_delay_ns=3_170_000,
        noise_pf=fdc1004.RATES[400].noise_ff * 1e-3,
        range_end_pf=fdc1004.capacitance_pf(fdc1004.CODE_MAX),
        absent_ns=57_000_000,
        stale_ns=21_000_000,
    ),
}
_ORDER = np.array(CONVERSION_ORDERS["lo_shu"])
#: Readings of a window: the last three of each element.
_WINDOW = READINGS * ELEMENTS
#: What the service assumes of the errors of a baseline and of the noise in a walk [pF].
_BASELINE_SIGMA_PF, _NOISE_SIGMA_PF = 0.54e-3, 1.1e-3
#: Free closure over the gap from which an element is saturated for certain [1].
_CERTAIN_SATURATION = 1.5
#: Random numbers of a foot for one step, at most.
_DRAWS_PER_STEP = 1024
#: Loads with closed cells whose response is computed at once.
_ROWS_AT_ONCE = 2048

Single = NDArray[np.float32]
#: Time after which nothing is remembered of a broken cable [ns].
_LONG_AGO_NS = -(10**9)


class VirtualForces(NamedTuple):
    """The last published force of each of n feet, as a controller has it at the time of a step.

    Attributes:
        force_n: Ground reaction on the foot, foot frame [N], shape (n, 3); NaN unless usable.
        sigma_n: Standard deviation of each component [N], shape (n, 3); NaN unless usable.
        state: State of each foot, shape (n,), uint8 of `State`.
        usable: Whether its force may be used, shape (n,).
        age_s: Age of the newest reading at the time of the step [s], shape (n,): that of six legs on average.
    """

    force_n: Array
    sigma_n: Array
    state: Array
    usable: Array
    age_s: Array


class FeetState(NamedTuple):
    """State of n feet between two steps; what begins with n is of each foot, the rest of their common clock.

    Attributes:
        read_pf: The last readings of each foot, newest last [pF], shape (n, history).
        closed: Whether a cell was closed at each of them, same shape.
        leans: Whether the contact was beyond the response table, same shape.
        force_n: Contact force at the last step [N], shape (n, 3).
        normal: Its normal, same shape.
        n_conversions: Conversions since the last reset, shape (n,), int32.
        absent_ns: Time from now until the last broken cable is found again [ns], shape (n,), int32.
        episode: Resets of each foot, shape (n,), int32.
        seed_key: Key of a foot for all episodes, shape (n,), int32.
        draw: What each foot is in this episode.
        number: Number of the newest conversion, shape (1,), int32.
        since_ns: Time since its middle [ns], shape (1,), int32.
        n_steps: Steps, shape (1,), int32.
    """

    read_pf: Array
    closed: Array
    leans: Array
    force_n: Array
    normal: Array
    n_conversions: Array
    absent_ns: Array
    episode: Array
    seed_key: Array
    draw: FootDraw
    number: Array
    since_ns: Array
    n_steps: Array


def of_feet(state: FeetState, rows: Any) -> FeetState:  # noqa: ANN401 - a slice or a mask
    """Return the state of some of the feet."""

    def own(part: Array) -> Array:
        return part if part is None or part.shape[0] == 1 else part[rows]

    return FeetState(*map(own, state._replace(draw=None)))._replace(draw=FootDraw(*map(own, state.draw)))


class FootModel:
    """A foot type with its electronics, in arrays of a library: pure functions from state to state.

    Args:
        foot_type: A released foot type, or a folder with a slash in its name.
        board: Electronics of a foot, as in a robot file.
        cable_breaks_per_s: Mean rate at which the cable of a foot breaks for 20 ms [1/s].
        uncertainty: What the service does not know of the feet, in sigma alone.
        variation: How the feet differ from the design and from episode to episode.
        xp: Module of the arrays, as `array_api_compat.array_namespace` returns it.
        device: Where they are; None for the library's default.

    Raises:
        ModelError: The models of the foot type are missing or damaged.
        ValueError: The board is another.

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
        uncertainty: ForceUncertainty = KNOWN_EXACTLY,
        variation: Variation = AS_DESIGNED,
        xp: ArrayModule,
        device: Array = None,
    ) -> None:
        if board not in SCANS:
            raise ValueError(f"board: {' or '.join(SCANS)}, got {board}")
        self.scan = scan = SCANS[board]
        folder = foot_type_folder(foot_type)
        self._response = response = FootResponse.load(folder / "response.npz")
        n_stepped = 2 * _WINDOW
        network = Network(folder / NETWORK_FILE, n_stepped)
        self._trained = trained = network.card.trained_inputs
        self._design = design = trained.design
        self._variation, self._cable_breaks_per_s = variation, cable_breaks_per_s
        self._xp, self._device = xp, device
        self._period_ns = ELEMENTS * scan.step_ns
        self._network = BatchNetwork(folder / NETWORK_FILE, 1e-9 * self._period_ns, xp, device)
        self._area_pf_um = EPS0_PF_UM_PER_MM2 * design.electrode_area_mm2
        self._lowest_z = math.sin(math.radians(response.min_elevation_deg))
        known = sensitivity(network, n_stepped, trained.moments)
        closure_per_pf = design.plate_distance_um(np.array(design.unloaded_pf)) / (design.gap_um * design.unloaded_pf)
        sigma_n = closure_per_pf * np.hypot(
            _BASELINE_SIGMA_PF * known.force_sigma_n_per_baseline_error,
            _NOISE_SIGMA_PF * known.force_sigma_n_per_reading_noise,
        )
        across_rel2, more_along_rel2 = variance_factors([uncertainty])
        self._across_rel2, self._more_along_rel2 = float(across_rel2[0, 0]), float(more_along_rel2[0, 0])
        imputation = Imputation(trained.moments)
        rms = imputation.rms_of_pattern
        # As `Imputation.residuals` without a set.
        scale = np.concatenate([np.ones((1, ELEMENTS)), rms[:1] / rms[1:] / OVERLOAD_RESIDUAL_REL])
        # Of each element's cells: shape (9, 6 * cells, products), point force before patch.
        cells = response.closure_coefficients.reshape(2, -1, 3, ELEMENTS, _CELLS)
        since = np.mod(np.arange(ELEMENTS)[:, None] - np.argsort(_ORDER), ELEMENTS)
        self._of = {
            name: self._array(value)
            for name, value in {
                "series": cells.transpose(3, 0, 2, 4, 1).reshape(ELEMENTS, -1, cells.shape[1]),
                "sigma_n2": sigma_n[:, None] ** 2,
                "residual": (scale[:, :, None] * imputation.residual_of_pattern).transpose(1, 2, 0),
                "least_rel": np.tile(trained.closure_rel_min, READINGS)[:, None],
                "most_rel": np.tile(trained.closure_rel_max, READINGS)[:, None],
                "usable_rel": trained.max_usable_closure_rel(np.full(ELEMENTS, design.gap_um))[:, None],
                "is_usable": IS_USABLE_STATE,
                # By the newest conversion's place in the scan: conversions since each reading of a window.
                "since": (since[:, None] + ELEMENTS * np.arange(READINGS)[:, None]).reshape(ELEMENTS, _WINDOW),
                "order": _ORDER,
                "bit": 2 ** np.arange(ELEMENTS)[:, None],
            }.items()
        }
        longest_ns = scan.send_delay_ns + round(1e9 * variation.delay_s[1])
        self.history = _WINDOW + -(-longest_ns // scan.step_ns) + scan.conversions_per_force

    def _array(self, value: Array) -> Array:
        value = np.asarray(value)
        kinds = {"f": np.float32, "i": np.int32, "b": np.bool_}
        return self._xp.asarray(value.astype(kinds[value.dtype.kind]), device=self._device)

    def clock(self, t_ns: int) -> Array:
        """Return a time [ns] as a step takes it, shape (1,), int32."""
        return self._array([t_ns])

    def start(self, n_feet: int, seed: int | NDArray[np.int_] = 0) -> FeetState:
        """Return feet in the air, tared, which have no force yet.

        Args:
            n_feet: Number of feet.
            seed: Seed of everything random, or one for each environment, shape (environments,), which have equal shares
                of the feet.

        Raises:
            ValueError: The feet cannot be shared among so many environments.
        """
        seeds = np.atleast_1d(np.asarray(seed))
        if n_feet % len(seeds):
            raise ValueError(f"{n_feet} feet cannot be shared among {len(seeds)} environments")
        per_seed = n_feet // len(seeds)
        words = [np.resize(np.arange(per_seed), n_feet)] + [np.repeat(seeds >> shift, per_seed) for shift in (0, 32)]
        key = self._array(np.zeros(n_feet, np.int32))
        for word in words:
            key = hashed(key + self._array(word.astype(np.uint32).view(np.int32)))
        xp = self._xp
        fill = {"device": self._device}
        none = self._array(np.zeros(n_feet, np.int32))
        one = self._array(np.zeros(1, np.int32))
        shape = (n_feet, self.history)
        state = FeetState(
            read_pf=xp.zeros(shape, dtype=xp.float32, **fill),
            closed=xp.zeros(shape, dtype=xp.bool, **fill),
            leans=xp.zeros(shape, dtype=xp.bool, **fill),
            force_n=xp.zeros((n_feet, 3), dtype=xp.float32, **fill),
            normal=self._array(np.tile([0.0, 0.0, 1.0], (n_feet, 1))),
            n_conversions=none,
            absent_ns=none + _LONG_AGO_NS,
            episode=none,
            seed_key=key,
            draw=self._drawn(key),
            number=one - 1,
            since_ns=one,
            n_steps=one,
        )
        return self.reset(state, xp.ones((n_feet,), dtype=xp.bool, **fill))

    def _drawn(self, key: Array) -> FootDraw:
        return draw_feet(self._xp, self._variation, self._design, self.scan.noise_pf, key)

    def reset(self, state: FeetState, feet: Array) -> FeetState:
        """Return the state after feet were lifted off the ground, tared, and drawn anew, for a new episode.

        Args:
            state: The state.
            feet: Which, shape (n,).
        """
        xp = self._xp
        episode = state.episode + xp.astype(feet, xp.int32)
        drawn = self._drawn(hashed(state.seed_key + episode))

        def renewed(new: Array, old: Array) -> Array:
            if new is None or new.shape[0] == 1:  # all are alike
                return new
            return xp.where(xp.reshape(feet, (-1,) + (1,) * (old.ndim - 1)), new, old)

        draw = FootDraw(*map(renewed, drawn, state.draw))
        # What was read last, element by element, in the air.
        element = self._elements(state.number, self.history)
        tared_pf = xp.broadcast_to(xp.take(draw.tared_pf, element, axis=1), state.read_pf.shape)
        one, none = feet[:, None], xp.zeros_like(state.closed)
        return state._replace(
            read_pf=xp.where(one, tared_pf, state.read_pf),
            closed=xp.where(one, none, state.closed),
            leans=xp.where(one, none, state.leans),
            force_n=xp.where(one, 0.0 * state.force_n, state.force_n),
            n_conversions=xp.where(feet, 0 * episode, state.n_conversions),
            absent_ns=xp.where(feet, 0 * episode + _LONG_AGO_NS, state.absent_ns),
            episode=episode,
            draw=draw,
        )

    def _elements(self, number: Array, n: int) -> Array:
        """Return the elements of the last n conversions, oldest first, shape (n,)."""
        xp = self._xp
        numbers = number + xp.arange(1 - n, 1, dtype=xp.int32, device=self._device)
        return xp.take(self._of["order"], numbers % ELEMENTS, axis=0)

    def step(
        self, state: FeetState, step_s: float, force_n: Array, normal: Array, noise: Array = None
    ) -> tuple[FeetState, VirtualForces]:
        """Return the state after a step, and the forces published last by its end; pure, for `jax.jit` and `lax.scan`.

        Args:
            state: State before it.
            step_s: Length of the step, at most 1 s, a number that is known when the function is compiled [s].
            force_n: Ground reaction on each foot in its frame [N], shape (n, 3); it changes linearly since the last step.
            normal: Unit normal of the ground, into the foot, same frame and shape; anything for a foot in the air.
            noise: Noise of the step's conversions over its standard deviation [1], shape (n, `conversions`),
                newest last; None for that of the seed.
        """
        step_ns = round(1e9 * step_s)
        state = self.advance(state, self.clock(step_ns), self.conversions(step_ns), force_n, normal, noise)
        return state, self.published(state)

    def conversions(self, step_ns: int) -> int:
        """Return the most conversions of a step [ns] that a force can tell."""
        return min(step_ns // self.scan.step_ns + 1, self.history)

    def advance(
        self, state: FeetState, step_ns: Array, n: int, force_n: Array, normal: Array, noise: Array = None
    ) -> FeetState:
        """Return the state after a step; as `step`, for a length that a compiled function does not know.

        Args:
            state: State before it.
            step_ns: Length of the step, at most 10^9, shape (1,), int32 [ns].
            n: `conversions` of that length.
            force_n: As of `step`.
            normal: As of `step`.
            noise: As of `step`.
        """
        xp, step = self._xp, self.scan.step_ns
        force_n, unit = xp.astype(force_n, xp.float32), xp.astype(normal, xp.float32)
        unit = xp.where(xp.any(force_n != 0.0, axis=1)[:, None], unit, state.normal)
        elapsed_ns = state.since_ns + step_ns
        n_new = elapsed_ns // step
        before = state
        state = state._replace(
            force_n=force_n,
            normal=unit,
            n_conversions=xp.clip(state.n_conversions + n_new, 0, 2 * self.history),
            absent_ns=xp.clip(state.absent_ns - step_ns, _LONG_AGO_NS),
            number=state.number + n_new,
            since_ns=elapsed_ns - n_new * step,
            n_steps=state.n_steps + 1,
        )
        is_whole = n_new >= n
        back = xp.arange(n - 1, -1, -1, dtype=xp.int32, device=self._device)
        ago_ns = xp.astype(state.since_ns + back * step, xp.float32)
        share = xp.clip(1.0 - ago_ns / xp.astype(step_ns, xp.float32), 0.0, 1.0)
        element = self._elements(state.number, n)
        read_pf, closed, leans = self._read(before, state, is_whole, share, element)
        first = state.n_steps * _DRAWS_PER_STEP
        if noise is None:
            noise = random_normal(xp, state.draw.key, first, n)
        read_pf = xp.clip(read_pf + state.draw.noise_pf * noise, max=self.scan.range_end_pf)
        def with_new(old: Array, new: Array) -> Array:
            whole = xp.concat([old[:, n:], new], axis=1)
            return xp.where(is_whole, whole, xp.concat([old[:, n - 1 :], new[:, 1:]], axis=1))

        state = state._replace(
            read_pf=with_new(before.read_pf, read_pf),
            closed=with_new(before.closed, closed),
            leans=with_new(before.leans, leans),
        )
        if not self._cable_breaks_per_s:
            return state
        # Once in a step at most, at any time of it.
        counter = first + n + xp.asarray([1, 2], dtype=xp.int32, device=self._device)
        draws = uniform(xp, state.draw.key[:, None], counter[None, :])
        step_s = 1e-9 * xp.astype(step_ns, xp.float32)
        breaks = draws[:, 0] < -xp.expm1(-self._cable_breaks_per_s * step_s)
        found_ns = self.scan.absent_ns - xp.astype(draws[:, 1] * xp.astype(step_ns, xp.float32), xp.int32)
        return state._replace(absent_ns=xp.where(breaks, found_ns, state.absent_ns))

    def _read(
        self, before: FeetState, after: FeetState, is_whole: Array, share: Array, element: Array
    ) -> tuple[Array, Array, Array]:
        """Return capacitances without noise [pF], whether a cell is closed, and whether the contact leans too far.

        Args:
            before: State before a step.
            after: After it, with force and normal.
            is_whole: Whether the oldest conversion is of this step, else it is the newest of the step before.
            share: Share of the step until each conversion [1], shape (k,).
            element: Its element, same shape.
        """
        xp, draw = self._xp, after.draw
        n, k = after.force_n.shape[0], share.shape[0]
        loaded = xp.any((before.force_n != 0.0) | (after.force_n != 0.0), axis=1)
        low = loaded & (after.normal[:, 2] < self._lowest_z)
        leans = xp.broadcast_to(low[:, None], (n, k))
        open_pf = xp.take(self._area_pf_um / draw.distance_um + draw.stray_pf, element, axis=1)
        feet = [before.force_n, after.force_n, after.normal, before.closed[:, -ELEMENTS:]]
        # Feet in the air need no table, where a library may look which they are.
        if is_lazy_array(loaded):
            read_pf, closed = self._loaded(*feet, is_whole, share, element, draw)
            return xp.where(loaded[:, None], read_pf, open_pf), closed & loaded[:, None], leans
        read_pf = xp.asarray(xp.broadcast_to(open_pf, (n, k)), copy=True)
        closed = xp.zeros((n, k), dtype=xp.bool, device=self._device)
        if xp.any(loaded):
            own = FootDraw(*(a if a is None or a.shape[0] == 1 else a[loaded] for a in draw))
            read_pf[loaded], closed[loaded] = self._loaded(*(a[loaded] for a in feet), is_whole, share, element, own)
        return read_pf, closed, leans

    def _loaded(
        self,
        from_n: Array,
        to_n: Array,
        normal: Array,
        closed_before: Array,
        is_whole: Array,
        share: Array,
        element: Array,
        draw: FootDraw,
    ) -> tuple[Array, Array]:
        """Return the capacitances of loaded feet without noise [pF], and whether a cell is closed, shape (n, k) each."""
        xp, k = self._xp, share.shape[0]
        if draw.mount is not None:
            from_n, to_n, normal = ((draw.mount @ a[:, :, None])[:, :, 0] for a in (from_n, to_n, normal))
        # Those below the table are lifted to its edge; `published` takes their force away.
        across = normal[:, :2]
        edge = math.sqrt(1.0 - self._lowest_z**2) / xp.sqrt(xp.sum(across * across, axis=1) + 1e-12)
        across = across * xp.where(normal[:, 2] < self._lowest_z, edge, xp.ones_like(edge))[:, None]
        normal = xp.concat([across, xp.clip(normal[:, 2:], min=self._lowest_z)], axis=1)
        # From here on feet are the last axis, the fastest.
        basis = self._basis(normal.T)
        now_n = from_n.T[None, :, :] + share[:, None, None] * (to_n - from_n).T[None, :, :]
        pressing_n = xp.abs(xp.sum(now_n * normal.T[None, :, :], axis=1, keepdims=True))
        hertz = 0.75 * self._response.ball_radius_mm / self._response.hertz_modulus_mpa
        point_n = now_n * draw.compliance.T[None, :, :]
        weights = xp.concat([point_n, (hertz * pressing_n) ** (2.0 / 3.0) * point_n], axis=1)
        distance_um, gap_um, gain = (
            xp.take(a, element, axis=1).T[:, None, :] for a in (draw.distance_um, draw.gap_um, draw.gain)
        )
        read, closed, mean_um = ([None] * k for _ in range(3))
        for first in range(min(k, ELEMENTS)):
            # The normal stays the same over the step: each element needs it once, however often it is read.
            per_newton_um = xp.take(self._of["series"], element[first : first + 1], axis=0)[0, ...] @ basis
            for now in range(first, k, ELEMENTS):
                free_um = functools.reduce(
                    operator.add,
                    (weights[now, c, :] * per_newton_um[c * _CELLS : (c + 1) * _CELLS, :] for c in range(6)),
                )
                closure_um = xp.minimum(free_um, gap_um[now, ...])
                if self._variation.gain_rel:
                    closure_um = xp.minimum(gain[now, ...] * closure_um, gap_um[now, ...])
                read[now] = xp.mean(1.0 / (distance_um[now, ...] - closure_um), axis=0)
                closed[now] = xp.max(free_um, axis=0) > gap_um[now, 0, :]
                mean_um[now] = xp.mean(free_um, axis=0)
        is_closed = xp.stack(closed, axis=1)
        read_pf = self._area_pf_um * xp.stack(read, axis=1) + xp.take(draw.stray_pf, element, axis=1)
        # A cell that is closed when its element was read last takes load from all others.
        lately = xp.where(
            is_whole,
            xp.concat([closed_before[:, 1:], is_closed], axis=1),
            xp.concat([closed_before, is_closed[:, 1:]], axis=1),
        )
        touches = functools.reduce(operator.or_, (lately[:, ago : ago + k] for ago in range(ELEMENTS)))
        touches = touches & (xp.stack(mean_um, axis=1) < _CERTAIN_SATURATION * gap_um[:, 0, :].T)
        if not is_lazy_array(touches) and not xp.any(touches):
            return read_pf, is_closed
        feet = draw.compliance, draw.gap_um, draw.distance_um, draw.gain, draw.stray_pf
        return self._on_host(self._with_contact, read_pf, touches, element, normal, now_n, *feet), is_closed

    def _basis(self, normal: Array) -> Array:
        """Return what `series_basis` does, by recurrence, shape (products, n), of normals, shape (3, n)."""
        xp, rim = self._xp, math.radians(self._response.fit_elevation_deg)
        plane = normal[:2, :] * ((1.0 + math.sin(rim)) / math.cos(rim) / (1.0 + normal[2:, :]))
        chebyshev = [xp.ones_like(plane), plane]
        while len(chebyshev) <= self._response.degree:
            chebyshev.append(2.0 * plane * chebyshev[-1] - chebyshev[-2])
        of_y = xp.stack([each[1, :] for each in chebyshev])
        rows = [of_x[:1, :] * of_y[: of_y.shape[0] - i, :] for i, of_x in enumerate(chebyshev)]
        return xp.concat(rows, axis=0)

    def _on_host(self, function: Any, like: Array, *arrays: Array) -> Array:  # noqa: ANN401 - any of this class
        """Return the result of a function of numpy's arrays, of shape and kind of the first; a trace calls it later."""
        arrays = (like, *arrays)
        if is_jax_array(like):
            jax = sys.modules["jax"]  # the caller's: the project does not need it
            return jax.pure_callback(function, jax.ShapeDtypeStruct(like.shape, like.dtype), *arrays)
        found = function(*(np.asarray(to_device(array, "cpu") if is_torch_array(array) else array) for array in arrays))
        return self._xp.asarray(found, device=self._device)

    def _with_contact(
        self,
        read_pf: Single,
        touches: Mask,
        element: NDArray[np.int32],
        normal: Single,
        now_n: Single,
        compliance: Single,
        gap_um: Single,
        distance_um: Single,
        gain: Single,
        stray_pf: Single,
    ) -> Single:
        """Return capacitances without noise, those of feet with closed cells anew [pF], shape (n, k)."""
        touched_pf = np.array(read_pf)
        cells_of = np.arange(N_CELLS).reshape(ELEMENTS, _CELLS)
        feet, columns = np.nonzero(touches)
        for start in range(0, len(feet), _ROWS_AT_ONCE):
            at = feet[start : start + _ROWS_AT_ONCE], columns[start : start + _ROWS_AT_ONCE]
            loads = normalized(normal[at[0]].astype(np.float64)), now_n[at[1], :, at[0]].astype(np.float64)
            for foot, column, free_um in zip(*at, self._response.free_closure_um(*loads), strict=True):
                here, soft = element[column], compliance[foot % len(compliance), 0]
                gaps_um, distances_um, gains, strays_pf = (
                    each[foot % len(each)].astype(np.float64) for each in (gap_um, distance_um, gain, stray_pf)
                )
                # Forces of cells on one another are over the compliance, which then stays the design's.
                solved = solve_contact_lcp(
                    soft * free_um, np.repeat(gaps_um, _CELLS), self._response.compliance_um_per_n
                )
                closure_um = gains[here] * solved.cell_closures_um[cells_of[here]]
                spacing_um = distances_um[here] - np.minimum(closure_um, gaps_um[here])
                touched_pf[foot, column] = self._area_pf_um * np.mean(1.0 / spacing_um) + strays_pf[here]
        return touched_pf

    def published(self, state: FeetState) -> VirtualForces:
        """Return the forces published last, of feet in a state."""
        xp, of, scan, draw = self._xp, self._of, self.scan, state.draw
        # The newest force that is sent, and has come: of a window that ends so many conversions ago.
        delay_ns = scan.send_delay_ns + draw.delay_ns
        early = xp.clip(-((state.since_ns - delay_ns) // scan.step_ns), min=0)
        ago = early + (state.number - early + 1) % scan.conversions_per_force
        since = xp.take(of["since"], (state.number - ago) % ELEMENTS, axis=0)
        columns = (self.history - 1 - ago)[:, None] - since

        def of_each(kept: Array, columns: Array) -> Array:
            if columns.shape[0] == 1:
                return xp.take(kept, columns[0, :], axis=1).T
            return xp.take_along_axis(kept, xp.astype(columns, xp.int64), axis=1).T

        window_pf = of_each(state.read_pf, columns)
        tared_um = self._area_pf_um / draw.tared_pf.T
        closure_rel = xp.concat([tared_um] * READINGS, axis=0) - self._area_pf_um / window_pf
        closure_rel = closure_rel / self._design.gap_um
        newest_rel = closure_rel[:ELEMENTS, :]
        age_ns = scan.send_delay_ns + scan.step_ns * since[:, :ELEMENTS].T
        force_n, sigma_n = self._network.estimate(
            xp.clip(closure_rel, of["least_rel"], of["most_rel"]),
            xp.astype(age_ns, xp.float32) / self._period_ns,
        )
        square_n2 = xp.sum(force_n * force_n, axis=0, keepdims=True)
        overloaded = (window_pf[:ELEMENTS, :] >= self.scan.range_end_pf) | (newest_rel > of["usable_rel"])
        # As the service's pipeline, its sum of sigma, and its states in the same order.
        max_n = self._trained.max_force_n
        max_sigma_n = MAX_SIGMA_REL * max_n
        variance_n2 = sigma_n * sigma_n + of["sigma_n2"]
        inconsistent_n2 = self._inconsistency_rel(closure_rel, overloaded) ** 2 * square_n2
        variance_n2 = xp.minimum(variance_n2 + inconsistent_n2, xp.clip(variance_n2, min=max_sigma_n**2))
        n_overloaded = xp.sum(xp.astype(overloaded, xp.int32), axis=0)
        sent_ago_ns = state.since_ns + ago * scan.step_ns - scan.send_delay_ns
        absent_ns = state.absent_ns + sent_ago_ns
        leans = of_each(state.leans, (self.history - 1 - ago)[:, None])[0, :]
        states = {
            State.DEGRADED: n_overloaded > 0,
            State.OUT_OF_RANGE: xp.any(newest_rel < of["least_rel"][:ELEMENTS, :], axis=0)
            | (square_n2[0, :] > max_n**2)
            | xp.any(variance_n2 > max_sigma_n**2, axis=0)
            | leans,
            State.STALE: (absent_ns > -scan.stale_ns) & (absent_ns <= 0),
            State.SATURATED: n_overloaded > MAX_OVERLOADED,
            State.ABSENT: (absent_ns > 0) & (absent_ns <= scan.absent_ns),
            State.STARTING: state.n_conversions <= ago,
        }
        code = xp.full(n_overloaded.shape, State.VALID, dtype=xp.int32, device=self._device)
        for each, holds in states.items():
            code = xp.where(holds, xp.full_like(code, each), code)
        usable = xp.take(of["is_usable"], code, axis=0)
        variance_n2 = variance_n2 + self._across_rel2 * square_n2 + self._more_along_rel2 * force_n * force_n
        unknown = xp.full_like(force_n, math.nan)
        age_ns = xp.astype(state.since_ns + ago * scan.step_ns, xp.float32)
        age_s = xp.broadcast_to(1e-9 * age_ns, code.shape)
        return VirtualForces(
            force_n=xp.where(usable, force_n, unknown).T,
            sigma_n=xp.where(usable, xp.sqrt(variance_n2), unknown).T,
            state=xp.astype(code, xp.uint8),
            usable=usable,
            age_s=xp.where(code == State.STARTING, unknown[0, :], age_s),
        )

    def _inconsistency_rel(self, closure_rel: Array, overloaded: Array) -> Array:
        """Return the service's sigma by elements that contradict the others, over the force [1], shape (1, n)."""
        xp, of = self._xp, self._of
        newest, before, oldest = (closure_rel[k * ELEMENTS : (k + 1) * ELEMENTS, :] for k in range(READINGS))
        pattern = xp.sum(xp.where(overloaded, of["bit"], xp.zeros_like(of["bit"])), axis=0)
        residual = xp.sum(xp.take(of["residual"], pattern, axis=2) * newest[None, :, :], axis=1)
        # An overloaded element is closed at least as far as it reads.
        size = xp.where(overloaded, residual, xp.abs(residual))
        worst = xp.clip(xp.max(size, axis=0, keepdims=True), min=0.0)
        moved = xp.maximum(xp.abs(newest - before), xp.abs(before - oldest))
        most = xp.max(moved, axis=0, keepdims=True)
        is_most = moved == most
        second = xp.max(xp.where(is_most, xp.zeros_like(moved), moved), axis=0, keepdims=True)
        n_most = xp.sum(xp.astype(is_most, xp.int32), axis=0, keepdims=True)
        second = xp.where(n_most > 1, most, second)
        rms = xp.sqrt(xp.mean(newest * newest, axis=0, keepdims=True))
        uncertain = xp.clip(worst - second - UNCERTAIN_RESIDUAL - UNCERTAIN_RESIDUAL_REL * rms, min=0.0)
        return uncertain / xp.clip(rms, min=RESIDUAL_LIMIT)
