"""The error-correcting code: a message over a loop of frames, and back from their scores."""
