"""Feet in a batch are the same in every library, for every foot on its own, and as their variation says.

torch is too large for the tests of a change; with it installed: python -m tests.unit.sim.test_feet_in_arrays torch
"""

import importlib
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import array_api_compat.numpy as xp
import numpy as np
import pytest

from footsense.errors import ModelError
from footsense.estimation.network import Network
from footsense.foot.network_card import add_checksum
from footsense.foot.type_folders import released_folder
from footsense.frames import State, Vector
from footsense.ports import Window
from footsense.sim import FootModel, Variation, VirtualFeet
from footsense.sim.fabrication import PAPER_TOLERANCES, FootTolerances
from footsense.sim.virtual.network import BatchNetwork

UP = np.array([0.0, 0.0, 1.0])
#: Everything that differs between feet.
VARIED = Variation(tolerances=PAPER_TOLERANCES, gain_rel=0.02, noise_rel=(0.5, 2.0), delay_s=(0.0, 4e-3))
#: Largest force of the released foot [N], and how far libraries may differ over it [1].
RANGE_N, SAME_REL = 2.0, 1e-5


def walked(asarray: Callable[[Any], Any], n: int = 24) -> tuple[Vector, Vector, Vector, Vector]:
    """Return forces, sigma, states and ages of feet that tread hard and softly, some of them reset on the way."""
    feet = VirtualFeet(
        n, variation=VARIED, cable_breaks_per_s=0.5, seed=np.arange(6), like=asarray(np.zeros(1, np.float32))
    )
    random = np.random.default_rng(0)
    lean, azimuth = np.radians(random.uniform(0.0, 45.0, n)), random.uniform(0.0, 6.28, n)
    normal = np.stack([np.sin(lean) * np.cos(azimuth), np.sin(lean) * np.sin(azimuth), np.cos(lean)], axis=1)
    peak_n, steps = random.uniform(0.0, 1.6, n), []
    for k in range(12):
        force_n = normal * (peak_n * np.sin(k / 3.0 + np.arange(n)).clip(0.0))[:, None]
        found = feet.step(0.015 * k, asarray(force_n.astype(np.float32)), asarray(normal.astype(np.float32)))
        if k == 7:
            feet.reset(asarray(np.arange(n) % 3 == 0))
        steps.append([np.asarray(part) for part in found])
    force_n, sigma_n, state, _, age_s = (np.stack(column) for column in zip(*steps, strict=True))
    return force_n, sigma_n, state, age_s


def assert_same_as_numpy(library: str) -> None:
    numpy, other = walked(np.asarray), walked(importlib.import_module(library).asarray)
    assert (numpy[2] == other[2]).all()
    assert {State.VALID, State.DEGRADED, State.STARTING} <= set(numpy[2].ravel().tolist())
    for here, there in zip(numpy[:2], other[:2], strict=True):
        np.testing.assert_allclose(there, here, rtol=0.0, atol=SAME_REL * RANGE_N)
    np.testing.assert_allclose(other[3], numpy[3], rtol=1e-6)


def test_the_standard_alone_suffices() -> None:
    assert_same_as_numpy("array_api_strict")


@pytest.mark.slow
@pytest.mark.lab
def test_jax_gives_the_forces_of_numpy() -> None:
    assert_same_as_numpy("jax.numpy")


@pytest.mark.slow
@pytest.mark.lab
def test_a_step_is_pure_and_runs_inside_a_compiled_loop() -> None:
    import jax
    import jax.numpy as jnp
    from array_api_compat import array_namespace

    up, force_n = np.tile(UP, (4, 1)).astype(np.float32), np.linspace(0.0, 12.0, 4)[:, None] * UP
    here = FootModel("hexapod-2kg", xp=xp, variation=Variation(noise_rel=(0.5, 1.0)))
    there = FootModel(
        "hexapod-2kg", xp=array_namespace(jnp.zeros(1)), variation=Variation(noise_rel=(0.5, 1.0))
    )

    def step(state: Any, load: Any) -> Any:
        return there.step(state, 0.01, load * force_n.astype(np.float32), jnp.asarray(up))

    loads = np.sin(np.arange(20.0) / 4.0).clip(0.0).astype(np.float32)
    _, published = jax.jit(lambda state: jax.lax.scan(step, state, jnp.asarray(loads)))(there.start(4, 7))
    state = here.start(4, 7)
    for k, load in enumerate(loads):
        state, found = here.step(state, 0.01, load * force_n, up)
        np.testing.assert_allclose(published.force_n[k], found.force_n, rtol=0.0, atol=SAME_REL * 28.8)
    assert found.usable.all()


def stepped(feet: VirtualFeet, force_n: Vector, n_steps: int = 12, step_s: float = 0.01) -> list[Any]:
    normal = np.tile(UP, (len(force_n), 1))
    return [feet.step(step_s * k, force_n, normal) for k in range(n_steps)]


def test_a_reset_is_of_its_feet_alone() -> None:
    """The others go on as if nothing had happened; those that are reset are other feet, and start again."""
    force_n = 0.6 * np.tile(UP, (6, 1))
    feet, same = (VirtualFeet(6, variation=VARIED, seed=5) for _ in range(2))
    before, _ = stepped(feet, force_n)[-1], stepped(same, force_n)
    again = np.arange(6) < 2
    feet.reset(again)
    found, expected = (each.step(0.125, force_n, np.tile(UP, (6, 1))) for each in (feet, same))
    assert found.state[:2].tolist() == [State.STARTING] * 2
    assert (found.force_n[2:] == expected.force_n[2:]).all()
    for t_s in (0.15, 0.18, 0.21):
        found = feet.step(t_s, force_n, np.tile(UP, (6, 1)))
    assert found.usable.all()
    moved_n = np.linalg.norm(found.force_n - before.force_n, axis=1)
    assert moved_n[:2].min() > 5.0 * moved_n[2:].max()


def test_environments_have_random_numbers_of_their_own() -> None:
    """Two with one seed are the same, whatever stands beside them; the feet of one are not."""
    force_n = 0.5 * np.tile(UP, (6, 1))
    found = stepped(VirtualFeet(6, seed=np.array([3, 9, 3])), force_n)[-1].force_n.reshape(3, 2, 3)
    assert (found[0] == found[2]).all()
    assert (found[0] != found[1]).all()
    assert (found[0, 0] != found[0, 1]).all()


@pytest.mark.parametrize(
    ("variation", "sigma_n"),
    [
        (Variation(baseline_error_ff=0.0, noise_rel=(0.0, 0.0)), 0.0),
        (Variation(baseline_error_ff=3.0), 0.0017),
        (Variation(noise_rel=(8.0, 8.0)), 0.0035),
        (Variation(gain_rel=0.05), 0.05 * 0.8 / 2.0),
        (Variation(tolerances=FootTolerances(stiffness_rel=0.2)), 0.2 * 0.8),
        (Variation(tolerances=FootTolerances(stray_pf=0.34)), 0.042),
    ],
    ids=["none", "baseline", "noise", "gain", "stiffness", "stray"],
)
def test_feet_differ_as_told(variation: Variation, sigma_n: float) -> None:
    """Of 40 feet: what is common to their elements in full, what each has of its own less."""
    force_n = 0.8 * np.tile(UP, (40, 1))
    found = stepped(VirtualFeet(40, variation=variation), force_n, n_steps=5, step_s=0.02)[-1]
    assert found.force_n[:, 2].std() == pytest.approx(sigma_n, rel=0.3, abs=1e-6)
    assert np.median(found.force_n[:, 2]) == pytest.approx(0.8, rel=0.04)


def test_a_turned_foot_feels_a_turned_force() -> None:
    variation = Variation(tolerances=FootTolerances(mount_deg=10.0))
    found = stepped(VirtualFeet(60, variation=variation), 0.8 * np.tile(UP, (60, 1)), 5, 0.02)[-1].force_n
    turned_deg = np.degrees(np.arctan2(np.linalg.norm(found[:, :2], axis=1), found[:, 2]))
    # Two of the three axes turn the force, whose contact they move too: the estimate errs by a few per cent.
    assert np.sqrt(np.square(turned_deg).mean()) == pytest.approx(10.0 * np.sqrt(2.0 / 3.0), rel=0.25)
    assert np.linalg.norm(found, axis=1) == pytest.approx(0.8, rel=0.03)


@pytest.mark.parametrize(("most_s", "step_s"), [(5e-3, 2e-4), (0.5, 0.01)])
def test_late_forces_are_the_same_later(most_s: float, step_s: float) -> None:
    """In steps of a fifth of a conversion 5 ms later to 0.2 ms, and older by that; also by as much as there may be."""
    force_n, late = np.linspace(0.0, 1.0, 800)[:, None, None] * UP, round(most_s / step_s)
    found = []
    for delay_s in (0.0, most_s):
        feet = VirtualFeet(1, variation=Variation(delay_s=(delay_s, delay_s)))
        steps = [feet.step(step_s * k, load_n, UP[None]) for k, load_n in enumerate(force_n[: 3 * late])]
        found.append(
            (np.array([step.force_n[0, 2] for step in steps]), np.array([step.age_s[0] for step in steps]))
        )
    (prompt_n, prompt_s), (late_n, late_s) = found
    known = np.isfinite(prompt_s)[:-late]
    assert np.array_equal(np.isfinite(late_s[late:]), known)
    assert late_n[late:][known] == pytest.approx(prompt_n[:-late][known], abs=1e-6)
    assert (late_s[late:] - prompt_s[:-late])[known] == pytest.approx(most_s, abs=1e-6)


@pytest.mark.parametrize(
    "variation",
    [Variation(), Variation(gain_rel=0.02), VARIED, Variation(tolerances=FootTolerances(mount_deg=3.0))],
    ids=["as designed", "worn", "varied", "turned"],
)
def test_sigma_says_how_much_the_feet_differ(variation: Variation) -> None:
    """Of 200 feet as nobody has calibrated them nine of ten err by less than two sigma; not because sigma is vast."""
    lean = np.array([np.sin(0.35), 0.0, np.cos(0.35)])
    feet, normal = VirtualFeet(200, "hexapod-2kg", variation=variation), np.tile(lean, (200, 1))
    for k in range(6):
        found = feet.step(0.02 * k, 8.0 * normal, normal)
    error_n = (found.force_n - 8.0 * normal)[found.usable]
    within = np.abs(error_n) < 2.0 * found.sigma_n[found.usable]
    assert within.mean(axis=0).min() > 0.9
    assert np.sqrt(np.square(error_n).sum(axis=1).mean()) > 0.2 * np.linalg.norm(found.sigma_n[0])


def test_the_network_in_arrays_is_that_of_the_service() -> None:
    path = released_folder("hexapod-2kg") / "network.onnx"
    random, n, period_s = np.random.default_rng(1), 50, 6.8e-3
    age_s = 2.7e-3 + period_s * (random.permutation(9) / 9.0 + np.arange(3.0)[:, None])
    closure_rel = random.uniform(0.0, 0.3, (n, 1, 9)) + random.normal(size=(n, 3, 9)) * 0.01
    load = Network(path, n).estimate(
        Window(closure_rel, np.broadcast_to(age_s, closure_rel.shape), np.zeros((n, 9), bool))
    )
    force_n, sigma_n = BatchNetwork(path, period_s, xp).estimate(
        closure_rel.reshape(n, 27).T.astype(np.float32), (age_s[0] / period_s).astype(np.float32)[:, None]
    )
    np.testing.assert_allclose(force_n.T, load.force_n, rtol=0.0, atol=SAME_REL * 28.8)
    np.testing.assert_allclose(sigma_n.T, load.sigma_n, rtol=1e-4)


def test_a_network_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "network.onnx"
    path.write_bytes(add_checksum(b"\x3a\x00"))  # an empty graph
    with pytest.raises(
        ModelError, match=r"network.onnx: no network for feet in a batch \(KeyError\('b1'\)\)"
    ):
        BatchNetwork(path, 7e-3, xp)


def test_a_robot_loads_no_arrays_of_others() -> None:
    code = (
        "import sys, footsense, footsense.daemon.service, footsense.sim; "
        "sys.exit(str({'array_api_compat', 'jax', 'torch'} & {*sys.modules} or ''))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (
            lambda: Variation(noise_rel=(2.0, 1.0)),
            r"noise_rel: a least and a most, neither below 0, got \(2.0, 1",
        ),
        (lambda: Variation(delay_s=(1, 5)), "delay_s: .* in seconds, at most 0.5, neither below 0, got"),
        (lambda: Variation(delay_s=0.01), "delay_s: a least and a most.* got 0.01"),  # type: ignore[arg-type]
        (lambda: Variation(gain_rel=-0.1), "gain_rel: is an rms value, not below 0, got -0.1"),
        (lambda: Variation(baseline_error_ff=np.nan), "baseline_error_ff: .* got nan"),
        (lambda: VirtualFeet(1, cable_breaks_per_s=-1.0), "cable_breaks_per_s: a rate, not below 0, got -1"),
        (lambda: VirtualFeet(0), "n_feet: an integer above 0, got 0"),
        (lambda: VirtualFeet(2.5), "n_feet: an integer above 0, got 2.5"),  # type: ignore[arg-type]
        (lambda: VirtualFeet(2, seed=None), "seed: an integer, .* got None"),  # type: ignore[arg-type]
        (
            lambda: VirtualFeet(1).step(0.0, np.array([[0, 0, 30]]), UP[None]),
            "forces of floating point, got int64",
        ),
        (lambda: VirtualFeet(5, seed=np.arange(2)), "5 feet cannot be shared among 2 environments"),
        (
            lambda: stepped(VirtualFeet(1), UP[None], 2, 1.5),
            "a step at 1.5 s does not follow the one at 0.0 s within 1 s",
        ),
        (
            lambda: stepped(VirtualFeet(1, like=strict()), UP[None]),
            "these feet take arrays of array_api_strict",
        ),
        (
            lambda: VirtualFeet(2).step(0.0, np.stack([UP, -0.8 * UP]), np.tile(UP, (2, 1))),
            "a force points against its normal: both have to be the ground's, into the foot",
        ),
        (lambda: VirtualFeet(4).reset([1]), r"a mask of bool of the 4 feet; got int64, shape \(1,\)"),
        (lambda: VirtualFeet(4).reset(np.array([0, 1, 0, 1])), r"got int64, shape \(4,\)"),
        (lambda: VirtualFeet(4).reset([True]), r"got bool, shape \(1,\)"),
    ],
    ids=[
        "range",
        "ms",
        "no pair",
        "gain",
        "baseline",
        "rate",
        "none",
        "half",
        "seed",
        "integers",
        "shares",
        "pause",
        "library",
        "sign",
        "numbers",
        "no mask",
        "short mask",
    ],
)
def test_nonsense_is_told_in_a_line(make: Callable[[], Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        make()


def strict() -> Any:
    return importlib.import_module("array_api_strict").zeros(1)


if __name__ == "__main__":
    assert_same_as_numpy(sys.argv[1])
    print(f"{sys.argv[1]}: the forces are those of numpy, within {SAME_REL:g} of the range")  # noqa: T201
