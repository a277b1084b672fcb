"""Means and deviations of readings and reference samples within a time span."""

import numpy as np

from footsense.frames import Mask, ReferenceSamples, Stamps, Vector


def column_means(values: Vector) -> Vector:
    """Return the mean of each column over its non-NaN rows, shape (columns,); NaN if there are none."""
    n = (~np.isnan(values)).sum(axis=0)
    return np.where(n > 0, np.nansum(values, axis=0) / np.maximum(n, 1), np.nan)


def column_deviations(values: Vector) -> Vector:
    """Return the standard deviation of each column over its non-NaN rows, shape (columns,)."""
    deviations: Vector = np.sqrt(column_means((values - column_means(values)) ** 2))
    return deviations


def unsaturated_samples_n(reference: ReferenceSamples, span_ns: tuple[int, int]) -> Vector:
    """Return the reference samples within a time span [ns] without saturated axes [N], shape (n, 3)."""
    return reference.force_n[is_in_span(reference.t_ns, span_ns) & ~reference.saturated]


def is_in_span(t_ns: Stamps, span_ns: tuple[int, int]) -> Mask:
    """Return the mask of the times within a span, both ends included [ns]."""
    is_inside: Mask = (t_ns >= span_ns[0]) & (t_ns <= span_ns[1])
    return is_inside
