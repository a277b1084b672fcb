"""Feet in a batch publish what the whole simulated service does under the same load."""

from typing import Any, Literal, NamedTuple, cast

import numpy as np
import pytest
from msgspec.structs import replace

from footsense.config import DEFAULT, SMALL_BOARD, Config
from footsense.daemon.service import open_service
from footsense.estimation.network import Network
from footsense.foot.directions import angles_between_deg
from footsense.foot.response_table import FootResponse
from footsense.foot.type_folders import released_folder
from footsense.frames import LEGS, ContactFrame, Cycle, Leg, State, Vector
from footsense.ports import Observer
from footsense.sim import VirtualFeet
from footsense.sim.faults.scene_faults import Absent
from footsense.sim.scene import Scene, load_scene
from footsense.sim.uncalibrated import uncertainty_of_uncalibrated

Name = Literal["ad7147", "fdc1004"]
ROBOTS: dict[Name, Config] = {"ad7147": DEFAULT, "fdc1004": SMALL_BOARD}
#: Begin of what is compared, and steps of the consumer [s].
FROM_S, STEP_S = 2.0, 1e-3
#: Of the forces that are published, at least.
PERIOD_S = 10.13e-3
UP = np.array([0.0, 0.0, 1.0])


class Published(NamedTuple):
    """What a consumer has at its steps: time [s], force and sigma [N], mean age of the legs' newest readings [s]."""

    t_s: Vector
    force_n: Vector
    sigma_n: Vector
    age_s: Vector


class Kept(Observer):
    """The frames of all conversions."""

    def __init__(self) -> None:
        self.frames: list[ContactFrame] = []

    def observe(self, cycle: Cycle) -> None:
        self.frames.append(cycle.forces)


def served(board: Name, scene: Scene, foot_type: str, duration_s: float) -> list[ContactFrame]:
    kept = Kept()
    with open_service(replace(ROBOTS[board], foot_type=foot_type), scene, real_time=False) as service:
        service.observers.append(kept)
        service.run(lambda: bool(kept.frames) and kept.frames[-1].t_sent_ns > duration_s * 1e9)
    return kept.frames


def loads(scene: Scene, times_s: Vector) -> tuple[Vector, Vector]:
    """Return true forces and normals at times, shape (n, legs, 3) each."""
    load = scene.load.build(round(scene.lead_in_s * 1e9))
    contacts = [[load.contact(leg, round(t_s * 1e9)) for leg in LEGS] for t_s in times_s.tolist()]
    return (
        np.array([[contact.force_n for contact in row] for row in contacts]),
        np.array([[contact.normal for contact in row] for row in contacts]),
    )


def held(board: Name, frames: list[ContactFrame], times_s: Vector) -> Published:
    publish_every = ROBOTS[board].effective_publish_every
    frames = frames[publish_every - 1 :: publish_every]
    sent_s = np.array([frame.t_sent_ns for frame in frames]) * 1e-9
    last = [frames[at - 1] for at in np.searchsorted(sent_s, times_s, "right")]
    return Published(
        times_s,
        np.array([frame.force_n for frame in last]),
        np.array([frame.sigma_n for frame in last]),
        times_s - np.array([frame.t_ns.mean() for frame in last]) * 1e-9,
    )


def stepped(board: Name, foot_type: str, scene: Scene, times_s: Vector) -> Published:
    """Return the same of feet in a batch, which begin a scan earlier."""
    folder = released_folder(foot_type)
    network, response = Network(folder / "network.onnx", 1), FootResponse.load(folder / "response.npz")
    unknown = uncertainty_of_uncalibrated(network, response, 1)
    feet = VirtualFeet(len(LEGS), foot_type, board=board, uncertainty=unknown)
    feet.step(times_s[0] - 0.025, *np.tile(UP, (2, len(LEGS), 1)) * [[[0.0]], [[1.0]]])
    steps = [
        feet.step(t_s, force_n, normal)
        for t_s, force_n, normal in zip(times_s.tolist(), *loads(scene, times_s), strict=True)
    ]
    columns = [np.array(column) for column in zip(*steps, strict=True)]
    return Published(times_s, columns[0], columns[1], columns[4])


def figures(found: Published, true_n: Vector) -> dict[str, Any]:
    """Return what a consumer sees: errors, lag, sigma and age."""
    max_n = np.linalg.norm(true_n, axis=2).max()
    loaded = np.linalg.norm(true_n, axis=2) > 0.1 * max_n
    assert np.isfinite(found.force_n).all()
    off_n = [
        float(np.square(found.force_n[50:] - true_n[50 - k : len(true_n) - k]).mean()) for k in range(20)
    ]
    k = int(np.argmin(off_n))
    before, here, after = off_n[k - 1 : k + 2]
    return {
        "rms_n": float(np.sqrt(np.square(found.force_n - true_n).mean())),
        "rms_at_peak_n": float(
            np.sqrt(np.square((found.force_n - true_n)[true_n[..., 2] > 0.8 * max_n]).mean())
        ),
        "direction_deg": float(angles_between_deg(true_n[loaded], found.force_n[loaded]).mean()),
        "lag_ms": k + 0.5 * (before - after) / (before - 2 * here + after),
        "sigma_n": float(np.sqrt(np.square(found.sigma_n).mean())),
        "sigma_p50_n": float(np.median(found.sigma_n[loaded])),
        "age_ms": 1e3 * float(found.age_s.mean()),
    }


@pytest.mark.slow
@pytest.mark.parametrize("board", ROBOTS)
@pytest.mark.parametrize(
    ("name", "foot_type", "same_rel"),
    [("measured_walk", "aoyagi-3x3", 0.12), ("hexapod_2kg", "hexapod-2kg", 0.1)],
)
def test_errors_and_lag_are_those_of_the_service(
    board: Name, name: str, foot_type: str, same_rel: float
) -> None:
    """Those of the paper's foot less so, which closes gaps in a tenth of its walk."""
    scene = load_scene(name)
    times_s = np.arange(FROM_S, 10.0, STEP_S)
    true_n, _ = loads(scene, times_s)
    service = figures(held(board, served(board, scene, foot_type, 10.0), times_s), true_n)
    batch = figures(stepped(board, foot_type, scene, times_s), true_n)
    for figure, share in {"age_ms": 0.04, "lag_ms": 0.05}.items():
        assert batch.pop(figure) == pytest.approx(service.pop(figure), rel=share)
    assert batch == pytest.approx(service, rel=same_rel)


@pytest.mark.parametrize("board", ROBOTS)
def test_a_broken_cable_takes_the_force_away_for_as_long_as_of_the_service(board: Name) -> None:
    """Of one leg after the other, each at another moment of a scan."""
    breaks_s = [1.2 + 0.1031 * number for number in range(len(LEGS))]
    faults = tuple(
        Absent(leg=cast("Leg", leg), at_s=at_s, until_s=at_s + 0.02)
        for leg, at_s in zip(LEGS, breaks_s, strict=True)
    )
    frames = served(board, replace(load_scene("hanging"), faults=faults), "aoyagi-3x3", 1.9)
    frames = [frame for frame in frames if frame.t_sent_ns > 1e9]
    step_s = 1e-9 * (frames[-1].t_sent_ns - frames[0].t_sent_ns) / (len(frames) - 1)
    states = np.array([frame.state for frame in frames])
    feet = VirtualFeet(500, board=board, cable_breaks_per_s=0.4)
    flying = np.zeros((500, 3)), np.tile(UP, (500, 1))
    found = np.array([feet.step(t_s, *flying).state for t_s in np.arange(0.0, 3.0, PERIOD_S)])[2:]
    n_breaks = np.count_nonzero((found[1:] == State.ABSENT) & (found[:-1] == State.VALID))
    assert n_breaks == pytest.approx(600, rel=0.15)
    for state in (State.ABSENT, State.STALE):
        lasted_s = PERIOD_S * np.count_nonzero(found == state) / n_breaks
        of_service_s = step_s * np.count_nonzero(states == state) / len(LEGS)
        assert lasted_s == pytest.approx(of_service_s, abs=0.4 * PERIOD_S)
    assert set(np.unique(states)) <= {State.ABSENT, State.STALE, State.DEGRADED, State.VALID}


def test_what_cannot_be_told_is_not_usable() -> None:
    """Too much load, a contact beyond the response table, and a foot that was just reset; the others go on."""
    feet = VirtualFeet(4)
    normal = np.array([UP, UP, [np.sqrt(0.96), 0.0, 0.2], UP])
    force_n = normal * [[0.5], [5.0], [0.5], [0.5]]
    for t_s in np.arange(0.0, 0.15, PERIOD_S).tolist():
        found = feet.step(t_s, force_n, normal)
    assert found.state.tolist() == [State.VALID, State.SATURATED, State.OUT_OF_RANGE, State.VALID]
    assert (
        np.isfinite(found.force_n).all(axis=1).tolist() == found.usable.tolist() == [True, False, False, True]
    )
    feet.reset(np.array([False, False, False, True]))
    force_n[3] = 0.0
    found = feet.step(0.143, force_n, normal)
    assert found.state.tolist() == [State.VALID, State.SATURATED, State.OUT_OF_RANGE, State.STARTING]
    found = feet.step(0.18, force_n, normal)
    assert found.force_n[3] == pytest.approx(0.0, abs=0.01)


def test_without_a_board_the_feet_are_those_of_the_default_robot() -> None:
    feet = (VirtualFeet(1), *(VirtualFeet(1, board=board) for board in ROBOTS))
    for t_s in (0.0, 0.03, 0.1):
        unnamed, ad7147, fdc1004 = [each.step(t_s, UP[None], UP[None]).force_n for each in feet]
    assert (unnamed == ad7147).all()
    assert (unnamed != fdc1004).all()


@pytest.mark.parametrize(
    ("t_s", "n_feet", "length", "said"),
    [
        (0.0, 2, 1.0, "does not follow"),
        (1.0, 3, 1.0, r"2 feet got forces \(3, 3\)"),
        (1.0, 2, 0.5, "unit vector"),
    ],
)
def test_nonsense_is_refused(t_s: float, n_feet: int, length: float, said: str) -> None:
    feet, up = VirtualFeet(2), np.tile(UP, (n_feet, 1))
    feet.step(0.0, up[:2], up[:2])
    with pytest.raises(ValueError, match=said):
        feet.step(t_s, up, length * up)
