"""Simulator: feet, chips at byte level, buses in bit time, scenes. It imports no driver.

Public is `VirtualFeet`, thousands of feet at once for whoever trains a controller.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from footsense.sim.virtual_feet import VirtualFeet, VirtualForces

__all__ = ["VirtualFeet", "VirtualForces"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - of a module
    if name not in __all__:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    from footsense.sim import virtual_feet

    return getattr(virtual_feet, name)
