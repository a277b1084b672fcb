"""The chain from contact forces to published forces as a pure function of arrays, which a library may compile.

Each conversion reads the next element of all feet under the load at its middle; a force is estimated from the last 27
readings of a foot at the time at which it is sent. So a step keeps readings alone, and what is published follows from
them and the clock. Numbers are float32 and int32, times whole nanoseconds, as a GPU is fast with.

Gaps that close are solved on the host, between two parts that a library may compile.
"""

import math

import numpy as np
from array_api_compat import is_lazy_array
from numpy.typing import NDArray

from firmware_interface.conversion_order import CONVERSION_ORDERS
from footsense.estimation.elements import RESIDUAL_LIMIT, UNCERTAIN_RESIDUAL, UNCERTAIN_RESIDUAL_REL
from footsense.estimation.missing_elements import MAX_OVERLOADED, Imputation
from footsense.estimation.network import READINGS, Network, sensitivity
from footsense.estimation.pipeline import MAX_SIGMA_REL
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.parameters import KNOWN_EXACTLY, ForceUncertainty, variance_factors
from footsense.foot.response_table import FootResponse
from footsense.foot.type_folders import foot_type_folder
from footsense.frames import ELEMENTS, IS_USABLE_STATE, State
from footsense.sim.virtual.network import Array, ArrayModule, BatchNetwork
from footsense.sim.virtual.response import BatchResponse, Conversions, StepLoads, StepReadings
from footsense.sim.virtual.scan import SCANS, Board
from footsense.sim.virtual.state import FeetState, Step, VirtualForces, is_traced, of_rows
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
#: StepReadings of a window: the last three of each element.
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
        response = FootResponse.load(folder / "response.npz")
        self._response = BatchResponse(response, xp, device)
        n_stepped = 2 * _WINDOW
        network = Network(folder / NETWORK_FILE, n_stepped)
        self._trained = trained = network.card.trained_inputs
        self._design = design = trained.design
        self._variation, self._cable_breaks_per_s = variation, cable_breaks_per_s
        self._xp, self._device = xp, device
        self._index_type = xp.__array_namespace_info__().default_dtypes(device=device)["indexing"]
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
        across_rel2, more_along_rel2 = variance_factors([uncertainty])
        self._across_rel2, self._more_along_rel2 = float(across_rel2[0, 0]), float(more_along_rel2[0, 0])
        since = np.mod(np.arange(ELEMENTS)[:, None] - np.argsort(_ORDER), ELEMENTS)
        self._of = {
            name: self._array(value)
            for name, value in {
                "sigma_n2": sigma_n[:, None] ** 2,
                "residual": Imputation(trained.moments).overload_residuals().transpose(1, 2, 0),
                "least_rel": np.tile(trained.closure_rel_min, READINGS)[:, None],
                "most_rel": np.tile(trained.closure_rel_max, READINGS)[:, None],
                "usable_rel": trained.max_usable_closure_rel(np.full(ELEMENTS, design.gap_um))[:, None],
                "is_usable": IS_USABLE_STATE,
                # By the newest conversion's place in the scan: conversions since each reading of a window.
                "since": (since[:, None] + ELEMENTS * np.arange(READINGS)[:, None]).reshape(
                    ELEMENTS, _WINDOW
                ),
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
        words = [np.resize(np.arange(per_seed), n_feet)] + [
            np.repeat(seeds >> shift, per_seed) for shift in (0, 32)
        ]
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
            force_n: Ground reaction on each foot in its frame [N], shape (n, 3); linear in time since the last step.
            normal: Unit normal of the ground, into the foot, same frame and shape; anything for a foot in the air.
            noise: Noise of the step's conversions over its standard deviation [1], shape (n, `conversions`),
                newest last; None for that of the seed.
        """
        step_ns = round(1e9 * step_s)
        state = self.advance(state, self.clock(step_ns), self.conversions(step_ns), force_n, normal, noise)
        return state, self.published(state)

    def conversions(self, step_ns: int) -> int:
        """Return the most conversions of a step [ns] that change its force."""
        return min(step_ns // self.scan.step_ns + 1, self.history)

    def advance(
        self, state: FeetState, step_ns: Array, n: int, force_n: Array, normal: Array, noise: Array = None
    ) -> FeetState:
        """Return the state after a step; as `step`, for a length that a compiled function does not know.

        Args:
            state: State before it.
            step_ns: `clock` of its length, at most 10^9 [ns].
            n: `conversions` of that length.
            force_n: As of `step`.
            normal: As of `step`.
            noise: As of `step`.
        """
        reading = self.read(state, step_ns, n, force_n, normal)
        return self.keep(state, step_ns, self.with_contact(reading), noise)

    def read(self, state: FeetState, step_ns: Array, n: int, force_n: Array, normal: Array) -> Step:
        """Return the first part of `advance`, pure: what the feet read if a closed cell takes no load from others."""
        xp, step, draw = self._xp, self.scan.step_ns, state.draw
        force_n, unit = xp.astype(force_n, xp.float32), xp.astype(normal, xp.float32)
        unit = xp.where(xp.any(force_n != 0.0, axis=1)[:, None], unit, state.normal)
        elapsed_ns = state.since_ns + step_ns
        n_new = elapsed_ns // step
        after = state._replace(
            force_n=force_n,
            normal=unit,
            n_conversions=xp.clip(state.n_conversions + n_new, 0, 2 * self.history),
            absent_ns=xp.clip(state.absent_ns - step_ns, _LONG_AGO_NS),
            number=state.number + n_new,
            since_ns=elapsed_ns - n_new * step,
            n_steps=state.n_steps + 1,
        )
        back = xp.arange(n - 1, -1, -1, dtype=xp.int32, device=self._device)
        ago_ns = xp.astype(after.since_ns + back * step, xp.float32)
        share = xp.clip(1.0 - ago_ns / xp.astype(step_ns, xp.float32), 0.0, 1.0)
        conversions = Conversions(share, self._elements(after.number, n))
        loads = StepLoads(state.force_n, force_n, unit)
        loaded = xp.any((loads.from_n != 0.0) | (force_n != 0.0), axis=1)
        open_pf = xp.take(self._response.open_pf(draw), conversions.element, axis=1)
        # Feet in the air need no table, where a library may look which they are.
        if is_lazy_array(loaded):
            found = self._response.read(loads, conversions, draw)
            readings = found._replace(
                read_pf=xp.where(loaded[:, None], found.read_pf, open_pf),
                closed=found.closed & loaded[:, None],
            )
        else:
            readings = StepReadings(
                xp.asarray(xp.broadcast_to(open_pf, (loaded.shape[0], n)), copy=True),
                xp.zeros((loaded.shape[0], n), dtype=xp.bool, device=self._device),
                xp.zeros((loaded.shape[0], n), dtype=xp.float32, device=self._device),
            )
            if xp.any(loaded):
                own = FootDraw(*(of_rows(part, loaded) for part in draw))
                found = self._response.read(StepLoads(*(part[loaded] for part in loads)), conversions, own)
                for whole, part in zip(readings, found, strict=True):
                    whole[loaded] = part
        is_whole = n_new >= n
        touches = self._response.touching(state.closed[:, -ELEMENTS:], readings, is_whole) & loaded[:, None]
        return Step(after, loads, conversions, readings, touches, is_whole)

    def with_contact(self, reading: Step) -> Step:
        """Return the second part: readings that closed cells of other elements change, solved on the host.

        In a trace there is no host, and nothing changes: as if a closed cell took no load from others.
        """
        if is_traced(reading.touches) or not self._xp.any(reading.touches):
            return reading
        read_pf = self._response.with_contact(
            reading.readings.read_pf, reading.touches, reading.loads, reading.conversions, reading.after.draw
        )
        return reading._replace(readings=reading.readings._replace(read_pf=read_pf))

    def keep(self, state: FeetState, step_ns: Array, reading: Step, noise: Array = None) -> FeetState:
        """Return the state after the third part of `advance`, pure: readings with noise, and cables that break."""
        xp, after, n = self._xp, reading.after, reading.touches.shape[1]
        first = after.n_steps * _DRAWS_PER_STEP
        if noise is None:
            noise = random_normal(xp, after.draw.key, first, n)
        read_pf = reading.readings.read_pf + after.draw.noise_pf * xp.astype(noise, xp.float32)
        low = after.normal[:, 2] < self._response.lowest_z
        low = low & xp.any((state.force_n != 0.0) | (after.force_n != 0.0), axis=1)

        def with_new(old: Array, new: Array) -> Array:
            whole = xp.concat([old[:, n:], new], axis=1)
            return xp.where(reading.is_whole, whole, xp.concat([old[:, n - 1 :], new[:, 1:]], axis=1))

        after = after._replace(
            read_pf=with_new(state.read_pf, xp.clip(read_pf, max=self.scan.range_end_pf)),
            closed=with_new(state.closed, reading.readings.closed),
            leans=with_new(state.leans, xp.broadcast_to(low[:, None], read_pf.shape)),
        )
        if not self._cable_breaks_per_s:
            return after
        # Once in a step at most, at any time of it.
        counter = first + n + xp.asarray([1, 2], dtype=xp.int32, device=self._device)
        draws = uniform(xp, after.draw.key[:, None], counter[None, :])
        length_ns = xp.astype(step_ns, xp.float32)
        breaks = draws[:, 0] < -xp.expm1(-1e-9 * self._cable_breaks_per_s * length_ns)
        found_ns = self.scan.absent_ns - xp.astype(draws[:, 1] * length_ns, xp.int32)
        return after._replace(absent_ns=xp.where(breaks, found_ns, after.absent_ns))

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
            return xp.take_along_axis(kept, xp.astype(columns, self._index_type), axis=1).T

        window_pf = of_each(state.read_pf, columns)
        tared_um = self._response.area_pf_um / draw.tared_pf.T
        closure_rel = xp.concat([tared_um] * READINGS, axis=0) - self._response.area_pf_um / window_pf
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
        code = xp.full(n_overloaded.shape, int(State.VALID), dtype=xp.int32, device=self._device)
        for each, holds in states.items():
            code = xp.where(holds, xp.full_like(code, int(each)), code)
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
            age_s=xp.where(state.n_conversions <= ago, unknown[0, :], age_s),
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
