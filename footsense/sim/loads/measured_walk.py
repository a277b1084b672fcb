"""Walk whose ground reaction forces are the measured ones of a walking person, scaled."""

from importlib.resources import files
from typing import NamedTuple

import numpy as np

from footsense.frames import ALL_LEGS, Vector
from footsense.sim.loads.walk import ReactionOverPhase, Walk

_NS_PER_S = 1_000_000_000
_RIGHT_LEGS = ("rf", "rm", "rr", "r4")


class MeasuredStride(NamedTuple):
    """One measured stride of a person: time from heel strike [s], force [N] of shape (n, 3), stride and stance [s]."""

    t_s: Vector
    force_n: Vector
    stride_s: float
    stance_s: float


def measured_strides_by_side() -> dict[str, MeasuredStride]:
    """Return the measured strides of the "right" and "left" foot of a person; x forward, y left, z up.

    Source:
        Ground reaction forces of subject11_noload_free_trial03 of the OpenSim project's models
        (Pipelines/Rajagopal/ExpData/grf_walk.mot), every second sample of 2 kHz; Rajagopal et al.,
        IEEE Trans. Biomed. Eng. 63(10), 2016.
    """
    text = files("footsense.sim.loads").joinpath("measured_walk_grf.csv").read_text(encoding="utf-8")
    data = np.loadtxt(text.splitlines(), delimiter=",", skiprows=1)
    t_s = data[:, 0]
    columns = {"right": slice(1, 4), "left": slice(4, 7)}
    touchdowns = {
        foot: t_s[np.flatnonzero(np.diff((data[:, own][:, 2] > 0).astype(int)) > 0) + 1]
        for foot, own in columns.items()
    }
    # Only the right foot strikes twice in the recording; both feet walk at the same pace.
    stride_s = float(touchdowns["right"][1] - touchdowns["right"][0])
    strides = {}
    for foot, own in columns.items():
        start_s = float(touchdowns[foot][0])
        inside = (t_s >= start_s) & (t_s < start_s + stride_s)
        force_n = data[inside, own]
        stance_s = float(t_s[inside][np.flatnonzero(force_n[:, 2] > 0)[-1]] - start_s)
        strides[foot] = MeasuredStride(t_s[inside] - start_s, force_n, stride_s, stance_s)
    return strides


def measured_walk(peak_force_n: float, pitch_deg: float, from_ns: int) -> Walk:
    """Return a tripod gait with measured ground reaction forces, scaled to `peak_force_n` vertically.

    Args:
        peak_force_n: Largest vertical force [N].
        pitch_deg: As of `Walk`.
        from_ns: As of `Walk`.
    """
    strides = measured_strides_by_side()
    largest_n = max(float(stride.force_n[:, 2].max()) for stride in strides.values())
    scale = peak_force_n / largest_n
    right = strides["right"]

    def replay_stride(stride: MeasuredStride) -> ReactionOverPhase:
        scaled_n = stride.force_n * scale
        last = len(scaled_n) - 1
        dt_s = float(stride.t_s[1] - stride.t_s[0])

        def reaction(phase: float) -> Vector:
            position = phase * stride.stride_s / dt_s
            index = min(int(position), last)
            following = min(index + 1, last)
            part = position - index
            reaction_n: Vector = (1 - part) * scaled_n[index] + part * scaled_n[following]
            return reaction_n

        return reaction

    by_foot = {foot: replay_stride(stride) for foot, stride in strides.items()}
    return Walk(
        reaction={leg: by_foot["right" if leg in _RIGHT_LEGS else "left"] for leg in ALL_LEGS},
        period_ns=round(right.stride_s * _NS_PER_S),
        duty_rel=max(stride.stance_s for stride in strides.values()) / right.stride_s,
        pitch_deg=pitch_deg,
        from_ns=from_ns,
    )
