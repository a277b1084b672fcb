"""Command `footsense record`: guided recording of calibration loads on a test stand."""
