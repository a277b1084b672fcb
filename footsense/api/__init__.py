"""The public interface of the package `footsense`: everything in `footsense.__all__`, one module per thing.

recording   read(...), simulate(...)  -> Recording            arrays of a walk
foot        Foot(...)                 force -> capacitance    the model of a foot type
estimator   Estimator(...)            capacitance -> force    the service's own estimation, on arrays

`footsense/__init__.py` imports one when it is asked for, and nothing else in the package does.
`footsense.connect` and the names with it are in `footsense.client`.
"""
