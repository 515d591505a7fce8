"""The torch decoder: Phi features and a linear head fitted per frame, exportable to ONNX."""
