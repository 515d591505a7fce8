"""Runs in the environment of ColorVideoVDP, not in ours: rate clips against their references.

    PYTHON cvvdp_worker.py CLIPS.npz DISPLAY FPS

The file holds pairs ``test0``, ``reference0``, ``test1``, and so on. Each is (frames, H, W, 3)
float32, encoded, in [0, 1]. For each pair one line with its quality in JOD is printed.
"""

import sys

import numpy as np


def main() -> None:
    """Rate all pairs of the file."""
    import pycvvdp  # type: ignore[import-not-found]

    clips, display, fps = np.load(sys.argv[1]), sys.argv[2], float(sys.argv[3])
    metric = pycvvdp.cvvdp(display_name=display, heatmap=None)
    for number in range(len(clips.files) // 2):
        pair = [clips[f"{name}{number}"] for name in ("test", "reference")]
        jod, _ = metric.predict(*pair, dim_order="FHWC", frames_per_second=fps)
        print(f"JOD {float(jod):.4f}", flush=True)


if __name__ == "__main__":
    main()
