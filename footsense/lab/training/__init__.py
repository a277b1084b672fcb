"""Networks: load cases, training, and export to ONNX."""
