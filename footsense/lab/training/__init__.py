"""Training of force networks: load cases, gaits, networks, export to ONNX."""
