"""Contact-force sensing for legged robots: from soft capacitive feet to forces on CAN.

::

    connect(...)    forces of a running service, live        for forces in feet: forces["lf"].force_n
    read(...)       a recorded walk as arrays                walk.t_s, walk.force_n
    simulate(...)   a simulated walk, with the true forces   walk.true_force_n
    Foot(...)       model of a foot type                     foot.capacitance_pf(force_n)
    Estimator(...)  capacitances to forces, on arrays        estimator.run(capacitance_pf, t_s)

`footsense.__all__` is the public interface, with `footsense.client` for a consumer that decodes CAN frames by itself.
All other modules are private to the project and change without notice. Errors that a user can cause are
`FootsenseError`, with one line of text, or `ValueError` for arrays.
"""

import os

# ONNX Runtime reads it when it is imported: else it starts a thread, which would inherit the loop's scheduling, and
# writes a device id and a database under ~/.cache.
os.environ["ORT_DISABLE_TELEMETRY"] = "1"

# OpenBLAS reads it when numpy is imported. Its threads wait for work by spinning, and the matrices here are small: on a
# busy machine the fit of a calibration took five times the processor time with two threads. One that is set wins.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

__version__ = "0.1.0"

TYPE_CHECKING = False  # as in `typing`, whose import takes longer than all of this
if TYPE_CHECKING:
    from firmware_interface.can.codes import State, StepPhase
    from footsense.api.estimator import EstimatedForces, Estimator
    from footsense.api.foot import Foot
    from footsense.api.recording import Recording, read, simulate
    from footsense.client.events import FootEvent
    from footsense.client.feet import Feet, connect
    from footsense.client.link import LegForce
    from footsense.errors import FootsenseError

__all__ = [
    "EstimatedForces",
    "Estimator",
    "Feet",
    "Foot",
    "FootEvent",
    "FootsenseError",
    "LegForce",
    "Recording",
    "State",
    "StepPhase",
    "connect",
    "read",
    "simulate",
]

#: Module of each public name, imported when the name is first used: the service needs none of `footsense.api`.
_MODULES = {
    "EstimatedForces": "footsense.api.estimator",
    "Estimator": "footsense.api.estimator",
    "Feet": "footsense.client.feet",
    "Foot": "footsense.api.foot",
    "FootEvent": "footsense.client.events",
    "FootsenseError": "footsense.errors",
    "LegForce": "footsense.client.link",
    "Recording": "footsense.api.recording",
    "State": "firmware_interface.can.codes",
    "StepPhase": "firmware_interface.can.codes",
    "connect": "footsense.client.feet",
    "read": "footsense.api.recording",
    "simulate": "footsense.api.recording",
}


if not TYPE_CHECKING:  # a type checker finds a wrong name by itself

    def __getattr__(name: str) -> object:
        if name not in _MODULES:
            raise AttributeError(f"module 'footsense' has no attribute {name!r}; it has {', '.join(__all__)}")
        from importlib import import_module

        try:
            value: object = getattr(import_module(_MODULES[name]), name)
        except ModuleNotFoundError as error:
            raise ImportError(
                f"footsense.{name} needs {error.name}, which footsense-client alone lacks; in the clone of footsense: "
                "activate its environment, or pip install deploy/client ."
            ) from None
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
