"""The receiver: camera frames to a message."""
