"""A scene: motion, loads, effects and faults of a simulated robot.

An effect that a scene does not name is not computed. `scene_files.py` reads scenes.
"""

from typing import Annotated

from msgspec import Meta

from footsense.sim import scene_loads
from footsense.sim.faults.scene_faults import Fault
from footsense.sim.scene_effects import Effects, ScenePart
from footsense.sim.scene_fabrication import Fabrication


class Scene(ScenePart, frozen=True):
    """Motion, loads, effects and faults of a simulated robot.

    Attributes:
        description: One line for the reader.
        load: Load of the feet.
        lead_in_s: Time before the load, all feet in the air: the feet are tared in it [s].
        host_cost_us: Cost of every I2C transaction on the host [us].
        seed: Seed of everything random.
        gait_table: Whether the capacitances over a gait cycle are computed once and interpolated, for long walks:
            0.2 fF off as long as no gap closes. Feet that enclose air are computed load by load.
        effects: Deviations from the ideal.
        fabrication: Deviations of the feet; None for feet as designed.
        faults: Faults.
    """

    description: str
    load: scene_loads.Load
    lead_in_s: Annotated[float, Meta(ge=0.0)] = 1.0
    host_cost_us: Annotated[float, Meta(ge=0.0, le=10_000.0)] = 0.0
    seed: Annotated[int, Meta(ge=0)] = 1
    gait_table: bool = False
    effects: Effects = Effects()
    fabrication: Fabrication | None = None
    faults: tuple[Fault, ...] = ()
