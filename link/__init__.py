"""The contract both ends of the link share; numpy and OpenCV only, imports nothing of ours."""

__version__ = "0.1.0"
