"""Loads of four feet as `foot_force` of Unitree's `LowState`, for estimators that are written for those robots.

One int16 per foot in the order FR, FL, RR, RL: the load along the leg, not a vector. Unitree states no unit ("int not
true value"), and its robots differ: estimators take a foot for one on the ground from 20 (go2_odometry) or 40
(Leg-KILO) on a Go2, from 220 on a Go1. Here it is N, rounded: a standing robot of 12 kg has 29 on each foot.

Source:
    LowState.msg and read_low_state.cpp of https://github.com/unitreerobotics/unitree_ros2; order and thresholds of
    scripts/inekf_odom.py of https://github.com/inria-paris-robotics-lab/go2_odometry and of legkilo/config of
    https://github.com/ouguangjun/Leg-KILO; that both fields are equal: issue 59 of unitree_ros_to_real.
"""

import dataclasses
import math
from collections.abc import Iterable
from functools import cache
from typing import Any, Final

import numpy as np

from footsense.ros2.store import LOW_STATE, STORE

#: The legs in Unitree's order.
FEET: Final = ("rf", "lf", "rr", "lr")


def low_state(loads_n: Iterable[float]) -> Any:  # noqa: ANN401 - a class that rosbags makes of the definition
    """Return a `LowState` of loads alone.

    IMU, motors and battery are unknown: NaN in each field of numbers with a point, 0 in the others.

    Args:
        loads_n: Load of each of `FEET` [N]; NaN where it is not known, which is sent as 0, a foot in the air.
    """
    loads = np.clip(np.rint(np.nan_to_num(np.array(list(loads_n)))), -32768, 32767).astype(np.int16)
    return dataclasses.replace(_blank(LOW_STATE), foot_force=loads, foot_force_est=loads)


@cache
def _blank(kind: str) -> Any:  # noqa: ANN401 - as above
    return STORE.types[kind](*(_blank_field(description) for _, description in STORE.fielddefs[kind][1]))


def _blank_field(description: Any) -> Any:  # noqa: ANN401 - of rosbags
    node, value = description
    if node.name == "NAME":
        return _blank(value)
    if node.name == "BASE":
        return math.nan if value[0].startswith("float") else 0
    (element, kind), length = value
    if element.name == "NAME":
        return [_blank(kind)] * length
    return np.full(length, _blank_field((element, kind)), kind[0])
