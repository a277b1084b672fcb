"""Missing closures from the others: exact where they decide, least squares where they do not."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from footsense.estimation.missing_elements import Imputation

seeds = st.integers(0, 2**32 - 1)
#: Some elements missing, never all.
masks = st.sets(st.integers(0, 8), min_size=1, max_size=8).map(
    lambda gone: np.isin(np.arange(9), sorted(gone))
)

Mask = NDArray[np.bool_]


def loads(seed: int, rank: int = 9, n: int = 60) -> NDArray[np.float64]:
    """Return closures that span so many dimensions, shape (n, 9), none of their patterns much rarer than another."""
    rng = np.random.default_rng(seed)
    basis, _ = np.linalg.qr(rng.normal(size=(9, 9)))
    closure_rel: NDArray[np.float64] = rng.uniform(-1.0, 1.0, (n, rank)) @ basis[:rank]
    return closure_rel


@given(seeds, masks)
def test_the_error_is_uncorrelated_with_what_is_known(seed: int, missing: Mask) -> None:
    """The normal equations of least squares: no linear read-out of the kept elements could improve the guess."""
    closure_rel = loads(seed)
    imputation = Imputation(closure_rel.T @ closure_rel)
    filled = imputation.impute(closure_rel, missing)
    error = (filled - closure_rel)[:, missing]
    np.testing.assert_allclose(error.T @ closure_rel[:, ~missing], 0.0, atol=1e-9)
    np.testing.assert_array_equal(filled[:, ~missing], closure_rel[:, ~missing])


@given(seeds, masks, st.sampled_from([np.nan, np.inf, -1e300, 7.0]))
def test_what_stands_in_a_missing_place_has_no_influence(seed: int, missing: Mask, rubbish: float) -> None:
    """NaN included, and the argument stays as it was."""
    closure_rel = loads(seed, n=3)
    imputation = Imputation(np.eye(9) + closure_rel.T @ closure_rel)
    spoilt = np.where(missing, rubbish, closure_rel)
    before = spoilt.copy()
    np.testing.assert_array_equal(imputation.impute(spoilt, missing), imputation.impute(closure_rel, missing))
    np.testing.assert_array_equal(spoilt, before)


def test_a_wrong_reading_counts_by_what_it_moves() -> None:
    """An element that follows another one tenfold is off tenfold with it; where none is missing, only the one is."""
    closure_rel = loads(1)
    closure_rel[:, 0] = 10.0 * closure_rel[:, 1]
    closure_rel[:, 0] += 1e-6 * loads(2)[:, 0]
    imputation = Imputation(closure_rel.T @ closure_rel)
    none, first, *_ = imputation.error_amplification
    assert none == 1.0
    np.testing.assert_allclose(first, np.hypot(10.0, 1.0), rtol=1e-3)
