"""What leaves the lab: the decoder as an ONNX graph, and the sender and receiver around it.

`runtime` decodes with numpy, OpenCV and onnxruntime alone; `to_onnx` writes the graph and `parity`
compares it with torch; `bench` times it. `send` shows a message on a display, `locate` finds the
display in a photograph, `pilots` finds one in a film that nothing marks, `receive` reads the
message from camera frames and says so in `events`, `web` builds the receiver as a web page, and
`package` packs it for other programs.
"""
