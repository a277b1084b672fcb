"""What lies beside a measured line, and what a conversion sees of it: the table of a foot type, and its use.

A converter excites a line with a square wave, and counts the charge that flows to everything of another potential. With
mutual capacitances C_k to the conductors beside it, whose potentials are v_k times that of the line, it finds

    sum over k of C_k (1 - v_k).

Ground has v = 0; a shield, or an input at the bias that follows the excitation, 1 without its tracking error. A
floating conductor has what balances its charge.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from footsense import strict_yaml
from footsense.frames import ROWS, Vector

#: Name of the file in the folder of a foot type.
COUPLINGS_FILE = "couplings.yaml"
#: Conductor of a table that is at ground: a common electrode, and whatever is around a foot; always the last.
GROUND = "gnd"
#: What a chip does with an input that it does not convert.
InputState = Literal["ground", "shield", "floating"]


class Couplings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What lies beside the measured lines: other lines, shields, ground.

    Attributes:
        idle_inputs: What a FDC1004 does with the inputs that it does not convert; no source says it.
        shield_error_rel: By how much a shield falls short of the excitation [1]; no source says it of a FDC1004.
    """

    idle_inputs: InputState = "ground"
    shield_error_rel: Annotated[float, Meta(ge=0.0, le=0.1)] = 0.01


class BoardCouplings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Couplings of a foot's lines with a board, without its elements.

    Attributes:
        conductors: Names of the nets, `GROUND` last.
        mutual_ff: Capacitance between each two in air [fF], symmetric, 0 on the diagonal.
        metal_ff: What grounded metal 1 mm beside the tails adds from each to ground [fF].
    """

    conductors: tuple[str, ...]
    mutual_ff: tuple[tuple[float, ...], ...]
    metal_ff: tuple[float, ...]

    @property
    def mutual_pf(self) -> Vector:
        """Capacitance between each two conductors in air [pF], shape (conductors, conductors)."""
        return 1e-3 * np.array(self.mutual_ff)

    @property
    def element_metal_ff(self) -> list[float]:
        """What metal beside the tails adds to the reading of each element [fF], by flat index: to that of its line."""
        by_name = dict(zip(self.conductors, self.metal_ff, strict=True))
        return [
            by_name.get(f"row{row + 1}col{column + 1}", by_name.get(f"col{column + 1}", 0.0))
            for row in range(ROWS)
            for column in range(ROWS)
        ]

    def places(self, names: Sequence[str]) -> list[int]:
        """Return the indices of conductors."""
        return [self.conductors.index(name) for name in names]


class CouplingTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Couplings of a foot type, as `footsense lab couplings` computes them of its drawn flexes.

    Attributes:
        foot_type: The foot type.
        boards: Couplings by board.
    """

    foot_type: str
    boards: dict[str, BoardCouplings]


def load_couplings(path: Path) -> CouplingTable:
    """Return the table in a file.

    Raises:
        ConfigError: It is missing, or is no such table.
    """
    return strict_yaml.load(path, CouplingTable, check=_contradiction)


def _contradiction(table: CouplingTable) -> strict_yaml.Problem | None:
    """Return the first contradiction in a table; None if there is none."""
    for board, found in table.boards.items():
        path, n = f"boards.{board}", len(found.conductors)
        if len(set(found.conductors)) < n or found.conductors[-1:] != (GROUND,):
            return strict_yaml.Problem(f"{path}.conductors", f"have to be different names, {GROUND} last")
        if any(len(row) != n for row in (found.metal_ff, found.mutual_ff, *found.mutual_ff)):
            return strict_yaml.Problem(path, f"needs {n} capacitances a row, as many as conductors")
        mutual = np.array(found.mutual_ff)
        if (mutual != mutual.T).any() or mutual.diagonal().any() or not (mutual >= 0.0).all():
            return strict_yaml.Problem(
                f"{path}.mutual_ff", "has to be symmetric, at least 0, and 0 on its diagonal"
            )
    return None


def potential_of(state: InputState, shield_error_rel: float) -> float:
    """Return the potential of a conductor over that of the line that is converted [1]; NaN of a floating one.

    Args:
        state: What its chip does with it; an input at the bias of an AD7147 is at the shield.
        shield_error_rel: By how much the shield falls short of the line [1].
    """
    return {"ground": 0.0, "shield": 1.0 - shield_error_rel, "floating": math.nan}[state]


def converted_pf(mutual_pf: Vector, line: int, potential: Vector) -> float:
    """Return the capacitance that a conversion of a line finds [pF].

    Args:
        mutual_pf: Capacitance between each two conductors, elements included [pF], shape (n, n), symmetric, 0 on the
            diagonal.
        line: The converted one.
        potential: Potential of each over that of the line [1], shape (n,); NaN of those that float.
    """
    potential = potential.copy()
    potential[line] = 1.0
    floating = np.flatnonzero(np.isnan(potential))
    if len(floating):
        potential[floating] = 0.0
        own = mutual_pf[np.ix_(floating, floating)]
        balance = np.diag(mutual_pf[floating].sum(axis=1)) - own
        potential[floating] = np.linalg.solve(balance, mutual_pf[floating] @ potential)
    return float(mutual_pf[line] @ (1.0 - potential))
