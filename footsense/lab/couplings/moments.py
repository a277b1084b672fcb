"""Capacitances per length of parallel strips, by the method of moments in two dimensions (Galerkin, pulses).

Strips are thin and lie in planes of constant height, in a homogeneous medium; around them is a grounded cylinder, or
beside them a grounded plane, of which each strip has an image.

Source:
    R. F. Harrington, Field Computation by Moment Methods, 1968, section 2.4 (charged conducting strips).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from footsense.frames import Vector

#: Electric constant [fF/mm], CODATA 2018.
EPS0_FF_PER_MM = 8.8541878128
#: Radius of the grounded cylinder around the strips [mm]: whatever is around a leg. The capacitance to it follows the
#: logarithm of the radius.
SURROUNDING_RADIUS_MM = 100.0
#: Segments of a strip, and the most of one that lies close to another.
N_SEGMENTS, _MAX_SEGMENTS = 16, 80


class Strip(NamedTuple):
    """A strip that is long in the direction across the section.

    Attributes:
        net: Its net; strips of one net have one potential.
        from_mm: One edge [mm].
        to_mm: The other edge, beyond it [mm].
        height_mm: Height of its plane [mm].
    """

    net: str
    from_mm: float
    to_mm: float
    height_mm: float = 0.0


def mutual_capacitance(
    strips: Sequence[Strip], *, plane_mm: float | None = None, n_segments: int = N_SEGMENTS
) -> tuple[list[str], Vector]:
    """Return the nets of strips and their mutual capacitances per length in vacuum, over the electric constant.

    Args:
        strips: The strips, all within the surrounding cylinder, none touching another of another net.
        plane_mm: Height of a grounded plane on one side of all of them [mm]; None for the cylinder.
        n_segments: Segments of a strip, at least.

    Returns:
        Nets in the order of their first strips, and capacitances [1], shape (nets, nets), symmetric: beside the
        diagonal between two nets, on it from a net to ground.
    """
    nets = list(dict.fromkeys(strip.net for strip in strips))
    edges = [_edges_mm(strip, strips, n_segments) for strip in strips]
    length = np.concatenate([np.diff(edge) for edge in edges])
    of_net = np.repeat([nets.index(strip.net) for strip in strips], [len(edge) - 1 for edge in edges])
    across = np.concatenate(edges)
    height = np.repeat([strip.height_mm for strip in strips], [len(edge) for edge in edges])
    # Mean potential of each segment times its length, for a charge of one per length on each segment.
    is_segment = np.diff(np.repeat(range(len(strips)), [len(edge) for edge in edges])) == 0
    pairs = np.ix_(is_segment, is_segment)
    potential = -_log_integral(across, height[:, None] - height)[pairs]
    if plane_mm is None:
        potential += math.log(SURROUNDING_RADIUS_MM) * length[:, None] * length
    else:
        potential += _log_integral(across, height[:, None] + height - 2.0 * plane_mm)[pairs]
    at_net = np.where(of_net[:, None] == np.arange(len(nets)), length[:, None], 0.0)
    charge = np.linalg.solve(potential, at_net)
    maxwell = 2.0 * np.pi * at_net.T @ charge
    mutual = -0.5 * (maxwell + maxwell.T)
    np.fill_diagonal(mutual, maxwell.sum(axis=1))
    return nets, mutual


def _edges_mm(strip: Strip, strips: Sequence[Strip], n_segments: int) -> Vector:
    """Return the edges of a strip's segments [mm], which are narrow where charge gathers."""
    width = strip.to_mm - strip.from_mm
    across = [
        abs(strip.height_mm - other.height_mm)
        for other in strips
        if other.height_mm != strip.height_mm
        and min(strip.to_mm, other.to_mm) > max(strip.from_mm, other.from_mm)
    ]
    n = max(n_segments, min(math.ceil(width / min(across)), _MAX_SEGMENTS)) if across else n_segments
    return strip.from_mm + 0.5 * width * (1.0 - np.cos(np.linspace(0.0, np.pi, n + 1)))


def _log_integral(edges: Vector, height: Vector) -> Vector:
    """Return the integral of ln(distance [mm]) over each pair of segments between neighbouring edges [mm2].

    Args:
        edges: Edges of the segments [mm], shape (n + 1,).
        height: Difference of the heights of each pair of edges [mm], shape (n + 1, n + 1).
    """
    across, height = edges[:, None] - edges, np.abs(height)
    square, other = across**2, height**2
    logarithm = np.log(np.maximum(square + other, np.finfo(float).tiny))
    twice = 0.25 * (square - other) * logarithm - 0.75 * square
    apart = height > 0.0
    twice[apart] += height[apart] * across[apart] * np.arctan(across[apart] / height[apart])
    return -np.diff(np.diff(twice, axis=0), axis=1)
