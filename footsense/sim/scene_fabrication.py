"""Fabrication of the feet of a scene."""

import dataclasses
from typing import Annotated

from msgspec import Meta

from footsense.sim.foot.fabrication import PAPER_TOLERANCES, REMOUNT_DEG, FootTolerances
from footsense.sim.scene_effects import ScenePart


class Fabrication(ScenePart, frozen=True):
    """Deviations of the feet from their design: rms values, as in `fabrication.FootTolerances`.

    Attributes:
        seed: Seed of the deviations.
        first: Number of the foot on the first leg; the other legs have the next ones.
        gap_um: Rms deviation of the gap of each element [um].
        film_um: Rms deviation of the film of each element [um].
        stray_pf: Rms stray of each element [pF].
        stiffness_rel: Rms deviation of the stiffness of the whole foot [1].
        mount_deg: Rotation of a foot on its leg [deg].
        remount_deg: Rotation added at each mounting [deg].
        mounting: Number of the mounting.
    """

    seed: Annotated[int, Meta(ge=0)] = 1
    first: Annotated[int, Meta(ge=0)] = 0
    gap_um: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    film_um: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    stray_pf: Annotated[float, Meta(ge=0.0, le=2.0)] = 0.0
    stiffness_rel: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.0
    mount_deg: Annotated[float, Meta(ge=0.0, le=10.0)] = 0.0
    remount_deg: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.0
    mounting: Annotated[int, Meta(ge=0)] = 0

    @classmethod
    def with_paper_tolerances(cls, *, seed: int, first: int, mounting: int) -> "Fabrication":
        """Return feet with the paper's fabrication tolerances, in one of their mountings."""
        rms = dataclasses.asdict(PAPER_TOLERANCES)
        return cls(seed=seed, first=first, mounting=mounting, remount_deg=REMOUNT_DEG, **rms)

    @property
    def tolerances(self) -> FootTolerances:
        """The rms values of the deviations."""
        rms = dataclasses.fields(FootTolerances)
        return FootTolerances(**{field.name: getattr(self, field.name) for field in rms})
