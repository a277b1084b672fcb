"""Table of available rubbers and sheet materials, with moduli and sources."""

from pathlib import Path
from typing import Annotated

from msgspec import Meta, Struct

from footsense.errors import FootsenseError
from footsense.lab.geometry import Material, Name
from footsense.strict_yaml import Problem, load

#: The table.
MATERIALS_TABLE = Path(__file__).with_name("materials.yaml")


#: Gent's relation is E = e (a + b S) / (100 - S) with these e [MPa], a and b.
_GENT_MPA, _GENT_A, _GENT_B = 0.0981 / (0.137505 * 2.54), 56.0, 7.62336


def youngs_mpa_of(shore_a: float) -> float:
    """Return a rubber's Young's modulus [MPa] from its Shore A hardness, within 20 % up to 80 Shore A.

    Source:
        A. N. Gent, On the relation between indentation hardness and Young's modulus, Rubber Chemistry and
        Technology 31, 1958, with the dimensions of ASTM D2240's indenter A.

    Example:
        >>> [round(youngs_mpa_of(shore_a), 1) for shore_a in (50, 70, 90)]
        [2.5, 5.5, 20.8]
    """
    return _GENT_MPA * (_GENT_A + _GENT_B * shore_a) / (100.0 - shore_a)


def shore_a_from_modulus(youngs_mpa: float) -> float:
    """Return a rubber's Shore A hardness from its Young's modulus [MPa], the inverse of `youngs_mpa_of`.

    Example:
        >>> round(shore_a_from_modulus(youngs_mpa_of(60.0)), 6)
        60.0
    """
    ratio = youngs_mpa / _GENT_MPA
    return (100.0 * ratio - _GENT_A) / (_GENT_B + ratio)


class Solid(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A rubber or sheet material of the materials table: modulus or hardness, Poisson's ratio, source.

    Attributes:
        name: Name, as options and pages use it.
        youngs_mpa: Young's modulus [MPa]; None to take it from the hardness.
        shore_a: Hardness [Shore A]; None where the modulus is measured.
        poisson: Poisson's ratio [1].
        source: Origin of the number.
    """

    name: Name
    poisson: Annotated[float, Meta(gt=0.0, lt=0.5)]
    source: Annotated[str, Meta(min_length=1)]
    youngs_mpa: Annotated[float, Meta(ge=0.01, le=1e4)] | None = None
    shore_a: (
        Annotated[float, Meta(ge=10.0, le=95.0, description="Gent's relation diverges at 100")] | None
    ) = None

    @property
    def material(self) -> Material:
        """Elastic constants of the material, as written in `foot.yaml`."""
        if self.youngs_mpa is not None:
            return Material(self.youngs_mpa, self.poisson)
        return Material(round(youngs_mpa_of(self.shore_a or 0.0), 2), self.poisson)


class Materials(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Available rubbers and sheet materials.

    Attributes:
        rubbers: Of the ball.
        sheets: Of the plates.
    """

    rubbers: Annotated[tuple[Solid, ...], Meta(min_length=1)]
    sheets: Annotated[tuple[Solid, ...], Meta(min_length=1)]

    def select_materials(self, names: tuple[str, ...]) -> "Materials":
        """Return the named materials; all rubbers (or all sheets) if none of them is named.

        Raises:
            FootsenseError: A name is not in the table.
        """
        known = [solid.name for solid in (*self.rubbers, *self.sheets)]
        for name in names:
            if name not in known:
                raise FootsenseError(f"--material {name}: not in the table, which has {', '.join(known)}")
        rubbers = tuple(solid for solid in self.rubbers if solid.name in names)
        sheets = tuple(solid for solid in self.sheets if solid.name in names)
        return Materials(rubbers=rubbers or self.rubbers, sheets=sheets or self.sheets)


def load_materials() -> Materials:
    """Return the table of rubbers and sheets.

    Raises:
        ConfigError: It does not fit.
    """
    return load(MATERIALS_TABLE, Materials, check=_incomplete_material)


def _incomplete_material(materials: Materials) -> Problem | None:
    """Return a problem for the first material without exactly one of modulus and hardness; else None."""
    for kind in ("rubbers", "sheets"):
        for place, solid in enumerate(getattr(materials, kind)):
            if (solid.youngs_mpa is None) == (solid.shore_a is None):
                return Problem(f"{kind}[{place}]", f"{solid.name} needs either youngs_mpa or shore_a")
    return None
