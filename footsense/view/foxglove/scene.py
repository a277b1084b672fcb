"""Messages in Foxglove's own schemas: forces as arrows, gap closures as grids, poses of the feet.

The feet stand where they do in the page's picture, not where the robot puts them: their places are not known here.
"""

import base64
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from footsense.frames import ContactFrame, State, Vector
from footsense.leg_words import LegPhase, phase_of, word_of

#: Frame of the feet, and place of each in it [m]: x forward, y left.
ROBOT_FRAME = "robot"
DISPLAYED_FOOT_POSITIONS_M = {
    side + place: (x_m, y_m, 0.0)
    for side, y_m in (("l", 0.15), ("r", -0.15))
    for place, x_m in (("f", 0.2), ("m", 0.0), ("r", -0.2), ("4", -0.4))
}
#: Length of the arrow of a newton, and side of a foot's grid [m].
_ARROW_M_PER_N = 0.1
_CLOSURE_GRID_SIDE_M = 0.06
_FOXGLOVE_FLOAT32 = 7
#: Parts of an entity that ours does not have.
_UNUSED_ENTITY_FIELDS = ("metadata", "cubes", "spheres", "cylinders", "lines", "triangles", "models")
_IDENTITY_ROTATION = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
_PHASE_COLOURS = {
    LegPhase.VALID: (0.06, 0.49, 0.54),
    LegPhase.DEGRADED: (0.89, 0.6, 0.1),
    LegPhase.TARING: (0.89, 0.6, 0.1),
    LegPhase.STARTING: (0.89, 0.6, 0.1),
}
_FAULT_COLOUR = (0.75, 0.15, 0.1)


def scene_update(forces: ContactFrame, legs: Sequence[str]) -> dict[str, Any]:
    """Return a `foxglove.SceneUpdate`: an arrow for the force on each foot, and a label with name and state."""
    stamp = _time_json(forces.t_sent_ns)
    entities = []
    for row, leg in enumerate(legs):
        state = State(int(forces.state[row]))
        colour = dict(zip("rgba", (*_PHASE_COLOURS.get(phase_of(state), _FAULT_COLOUR), 1.0), strict=True))
        force_n = forces.force_n[row]
        is_known = bool(np.isfinite(force_n).all())
        name = f"{leg} {force_n[2]:.2f} N" if is_known else f"{leg} {word_of(state)}"
        above = {
            "position": _point_json(DISPLAYED_FOOT_POSITIONS_M[leg], above_m=0.02),
            "orientation": _IDENTITY_ROTATION,
        }
        entities.append(
            {
                **{key: [] for key in _UNUSED_ENTITY_FIELDS},
                "timestamp": stamp,
                "frame_id": ROBOT_FRAME,
                "id": leg,
                "lifetime": {"sec": 1, "nsec": 0},
                "frame_locked": False,
                "arrows": [_arrow_json(leg, force_n, colour)] if is_known and force_n.any() else [],
                "texts": [
                    {
                        "pose": above,
                        "billboard": True,
                        "font_size": 14.0,
                        "scale_invariant": True,
                        "color": colour,
                        "text": name,
                    }
                ],
            }
        )
    return {"deletions": [], "entities": entities}


def _arrow_json(leg: str, force_n: Vector, colour: dict[str, float]) -> dict[str, Any]:
    length_m = max(float(np.linalg.norm(force_n)) * _ARROW_M_PER_N, 1e-6)
    return {
        "pose": {
            "position": _point_json(DISPLAYED_FOOT_POSITIONS_M[leg]),
            "orientation": orientation(force_n),
        },
        "shaft_length": 0.8 * length_m,
        "shaft_diameter": 0.006,
        "head_length": 0.2 * length_m,
        "head_diameter": 0.015,
        "color": colour,
    }


def orientation(direction: Vector) -> dict[str, float]:
    """Return the quaternion that rotates the x axis to a direction, shape (3,), not zero.

    Example:
        >>> {axis: round(part, 3) for axis, part in orientation(np.array([0.0, 0.0, 2.0])).items()}
        {'x': 0.0, 'y': -0.707, 'z': 0.0, 'w': 0.707}
    """
    x, y, z = (direction / np.linalg.norm(direction)).tolist()
    if x >= 0.0:
        w = math.sqrt((1.0 + x) / 2.0)
        return {"x": 0.0, "y": -z / (2.0 * w), "z": y / (2.0 * w), "w": w}
    # Half the angle from 1 - x and from the distance to the axis: 1 + x would cancel near -1, and squares underflow.
    across, sine = math.hypot(y, z), math.sqrt((1.0 - x) / 2.0)
    if across == 0.0:
        return {"x": 0.0, "y": 0.0, "z": 1.0, "w": 0.0}
    return {"x": 0.0, "y": -sine * (z / across), "z": sine * (y / across), "w": across / (2.0 * sine)}


def closure_grid(closure_rel: Vector, leg: str, t_ns: int) -> dict[str, Any]:
    """Return a `foxglove.Grid` of a foot's closures over the gap [1], shape (elements,); NaN where unknown.

    A grid's columns go along x, forward, and its rows along y, to the left; ours run the other way.
    """
    rows = math.isqrt(len(closure_rel))
    cells = closure_rel.reshape(rows, rows)[::-1, ::-1].T.astype("<f4")
    x_m, y_m, z_m = DISPLAYED_FOOT_POSITIONS_M[leg]
    corner = (x_m - _CLOSURE_GRID_SIDE_M / 2, y_m - _CLOSURE_GRID_SIDE_M / 2, z_m)
    return {
        "timestamp": _time_json(t_ns),
        "frame_id": ROBOT_FRAME,
        "pose": {"position": _point_json(corner), "orientation": _IDENTITY_ROTATION},
        "column_count": rows,
        "cell_size": dict.fromkeys("xy", _CLOSURE_GRID_SIDE_M / rows),
        "row_stride": 4 * rows,
        "cell_stride": 4,
        "fields": [{"name": "closure", "offset": 0, "type": _FOXGLOVE_FLOAT32}],
        "data": base64.b64encode(cells.tobytes()).decode(),
    }


def foot_transforms(legs: Sequence[str], t_ns: int) -> dict[str, Any]:
    """Return `foxglove.FrameTransforms` from the robot frame to each foot frame."""
    return {
        "transforms": [
            {
                "timestamp": _time_json(t_ns),
                "parent_frame_id": ROBOT_FRAME,
                "child_frame_id": leg,
                "translation": _point_json(DISPLAYED_FOOT_POSITIONS_M[leg]),
                "rotation": _IDENTITY_ROTATION,
            }
            for leg in legs
        ]
    }


def _point_json(place_m: tuple[float, float, float], above_m: float = 0.0) -> dict[str, float]:
    return {"x": place_m[0], "y": place_m[1], "z": place_m[2] + above_m}


def _time_json(t_ns: int) -> dict[str, int]:
    return {"sec": t_ns // 1_000_000_000, "nsec": t_ns % 1_000_000_000}
