"""The decoders as ONNX graphs: what writes, checks, times and runs them.

`runtime` decodes frame pairs and `film_graph` windows of film, with numpy, OpenCV and onnxruntime
alone; `to_onnx` writes the graphs, `parity` compares them with torch, and `bench` times them.
"""
