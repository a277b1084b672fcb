"""The network in use: one ONNX file that carries its own card."""
