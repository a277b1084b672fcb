"""Simulator: feet, chips at byte level, buses in bit time, scenes. It imports no driver.

Public is `VirtualFeet`, thousands of feet at once for whoever trains a controller, with `Variation`, how they differ,
`ForceUncertainty`, what the service does not know of them, and `FootModel`, the same as a pure function. They need the
extra `simulators`.
"""

from typing import TYPE_CHECKING, Any

from footsense.errors import install_line

if TYPE_CHECKING:
    from footsense.foot.parameters import ForceUncertainty
    from footsense.sim.virtual.feet import VirtualFeet
    from footsense.sim.virtual.foot_model import FootModel
    from footsense.sim.virtual.state import VirtualForces
    from footsense.sim.virtual.variation import Variation

__all__ = ["FootModel", "ForceUncertainty", "Variation", "VirtualFeet", "VirtualForces"]


def __getattr__(name: str) -> Any:  # noqa: ANN401 - of a module
    if name not in __all__:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    try:
        from footsense.sim.virtual import feet
    except ModuleNotFoundError as error:
        text = f"{error}; feet in a batch need, {install_line('simulators')}"
        raise ModuleNotFoundError(text, name=error.name) from None
    return getattr(feet, name)
