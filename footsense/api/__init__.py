"""The public interface of the package `footsense`: everything in `footsense.__all__`, one module per thing.

feet        connect(...)              -> Feet                 forces of a running service, from CAN
recording   read(...), simulate(...)  -> Recording            arrays of a walk
foot        Foot(...)                 force -> capacitance    the model of a foot type
estimator   Estimator(...)            capacitance -> force    the service's own estimation, on arrays

`footsense/__init__.py` imports one when it is asked for. Nothing else in the package does, but for `tare`, which the
command `footsense tare` shares with `Feet.tare`.
"""
