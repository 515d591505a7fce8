"""Everything that leaves the lab: the ONNX graph and what runs it."""
