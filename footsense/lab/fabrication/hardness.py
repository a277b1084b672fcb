"""Shore A hardness of a rubber from its Young's modulus: the inverse of `youngs_mpa_of`."""

#: Gent's relation is E = e (a + b S) / (100 - S) with these e [MPa], a and b.
_MPA, _A, _B = 0.0981 / (0.137505 * 2.54), 56.0, 7.62336


def shore_a_from_modulus(youngs_mpa: float) -> float:
    """Return the Shore A hardness of a rubber with a Young's modulus [MPa].

    Source:
        As `footsense.lab.design.inputs.materials.youngs_mpa_of`.

    Example:
        >>> from footsense.lab.design.inputs.materials import youngs_mpa_of
        >>> round(shore_a_from_modulus(youngs_mpa_of(60.0)), 6)
        60.0
    """
    ratio = youngs_mpa / _MPA
    return (100.0 * ratio - _A) / (_B + ratio)
