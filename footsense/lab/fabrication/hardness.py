"""Young's modulus of a rubber and its Shore A hardness.

Source:
    Gent, Rubber Chemistry and Technology 31, 896, 1958.
"""

#: Gent's coefficients: E = _MPA (_A + _B S) / (_C - _D S).
_MPA, _A, _B, _C, _D = 0.0981 / 0.137505, 56.0, 7.62336, 254.0, 2.54


def youngs_mpa(hardness: float) -> float:
    """Return Young's modulus of a hardness [MPa].

    Example:
        >>> round(youngs_mpa(60.0), 2)
        3.61
    """
    return _MPA * (_A + _B * hardness) / (_C - _D * hardness)


def shore_a(modulus_mpa: float) -> float:
    """Return the Shore A hardness of a modulus [MPa].

    Example:
        >>> round(shore_a(youngs_mpa(60.0)), 6)
        60.0
    """
    ratio = modulus_mpa / _MPA
    return (_C * ratio - _A) / (_B + _D * ratio)
