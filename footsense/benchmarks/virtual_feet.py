"""Feet in a batch, of whoever trains a controller: time of a step in each library, and how far their forces differ."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

import array_api_compat.numpy as xp
import numpy as np

from footsense.clock import stopwatch_ns
from footsense.foot.gap_contact import CELLS_PER_ELEMENT
from footsense.foot.network_card import NETWORK_FILE
from footsense.foot.response_table import FootResponse
from footsense.foot.type_folders import released_folder
from footsense.sim import FootModel, VirtualFeet
from footsense.sim.virtual.network import BatchNetwork
from footsense.sim.virtual.scan import Board

#: Feet at once, step of a controller [s], and force on each second foot [N].
_N_FEET, _STEP_S, _FORCE_N = 16384, 0.02, 8.0
_FOOT_TYPE = "hexapod-2kg"
#: Two vectors in and two out, state, whether it is usable, and age.
_BYTES_OF_LOAD_AND_RESULT = 4 * 4 * 3 + 2 + 4
#: Module of the arrays of each library; but for numpy, where it is installed.
_LIBRARIES = {"numpy": "numpy", "jax": "jax.numpy", "torch": "torch"}


def cost_of_a_foot(board: Board) -> dict[str, int]:
    """Return what a GPU computes and moves for a loaded foot in a step, counted from the arrays.

    Returns:
        Multiplications, each with an addition, of the response `table`, of the `cells` in all conversions, and of the
        `network`; the rest are some thousand. And the `bytes` of state, read and written, of what the foot is, of load
        and of result.
    """
    model = FootModel(_FOOT_TYPE, board=board, xp=xp)
    folder = released_folder(_FOOT_TYPE)
    of = BatchNetwork(folder / NETWORK_FILE, 1e-3, xp).weights
    channels = of["w2_scalars"].shape[1]
    mixed = (of["to_parts"].size + of["to_units"].size) * channels
    state = model.start(1)
    kept = sum(part.nbytes for name, part in state._asdict().items() if name != "draw")
    drawn = sum(part.nbytes for part in state.draw)
    return {
        "table": FootResponse.load(folder / "response.npz").closure_coefficients.size,
        "cells": 6 * CELLS_PER_ELEMENT * model.conversions(round(1e9 * _STEP_S)),
        "network": mixed
        + sum(of[name].size for name in ("w1", "w2_scalars", "outputs"))
        + 2 * of["w2_vectors"].size,
        "bytes": 2 * kept + drawn + _BYTES_OF_LOAD_AND_RESULT,
    }


def measure_virtual_feet(board: Board, n_feet: int = _N_FEET, n_steps: int = 5) -> dict[str, Any]:
    """Return the time of a step of `batch` feet, half of them loaded, in each library that is installed.

    The libraries take turns in each step. `step_ms` is the shortest, `over_numpy` its ratio to numpy's, and `off_n` the
    largest difference of a force from numpy's.

    Args:
        board: Electronics of the feet.
        n_feet: Feet at once.
        n_steps: Steps that are timed.
    """
    makes = {
        name: import_module(module).asarray
        for name, module in _LIBRARIES.items()
        if find_spec(name) is not None
    }
    single = np.zeros(1, np.float32)
    feet = {
        name: VirtualFeet(n_feet, _FOOT_TYPE, board=board, like=make(single)) for name, make in makes.items()
    }
    normal = np.tile(np.array([0.0, 0.0, 1.0], np.float32), (n_feet, 1))
    force_n = normal * np.resize(np.array([[_FORCE_N], [0.0]], np.float32), (n_feet, 1))
    best_ms, off_n, numpy_n = dict.fromkeys(feet, np.inf), dict.fromkeys(feet, 0.0), force_n
    for step in range(3 + n_steps):
        for name, each in feet.items():
            load = makes[name](force_n), makes[name](normal)
            start_ns = stopwatch_ns()
            told_n = np.asarray(each.step(step * _STEP_S, *load).force_n)  # waits for it
            if step >= 3:
                best_ms[name] = min(best_ms[name], 1e-6 * (stopwatch_ns() - start_ns))
            numpy_n = told_n if name == "numpy" else numpy_n
            off_n[name] = max(off_n[name], float(np.nan_to_num(np.abs(told_n - numpy_n)).max()))
    return {
        "batch": n_feet,
        "every_ms": 1e3 * _STEP_S,
        "cost_of_a_foot": cost_of_a_foot(board),
        **{
            name: {
                "step_ms": round(best_ms[name], 1),
                "over_numpy": round(best_ms[name] / best_ms["numpy"], 2),
                "off_n": float(f"{off_n[name]:.1g}"),
            }
            for name in feet
        },
    }
