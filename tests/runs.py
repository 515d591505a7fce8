"""A small stored run, as evaluate.py leaves it, for the tests of what reads it."""

from pathlib import Path
from typing import Any

import numpy as np

from link.images import write_image
from reports.engine.checked import write_json, write_sealed
from reports.engine.records import to_records
from reports.run import PREDICTIONS, STORIES, RunFolder, Story

META = {"simulated": True, "seed": 0, "command": "python evaluate.py"}


def prediction(method: str, index: int) -> dict[str, Any]:
    """A prediction of eight bits, the first of which are wrong, as a run stores it."""
    bits = [(index + i) % 2 for i in range(8)]
    wrong = {"naive": 3, "oorc": 2}.get(method, 0)
    scores = [(2.5 if bit else -2.5) * (-1 if i < wrong else 1) for i, bit in enumerate(bits)]
    cell = {"method": method, "pair": "canon-lg", "view_deg": 45.0, "kappa": 3, "index": index}
    return {**cell, "picture": "p", "bits": bits, "scores": scores}


def write_run(path: Path) -> None:
    """A finished run that has every file, each as small as it may be."""
    run = RunFolder(path)
    run.claim({"seed": 0, "ratex": 5, "checkpoints": {"learned": "0123456789abcdef"}})
    main = [prediction(m, i) for m in ("naive", "oorc", "learned") for i in range(5)]
    write_sealed(path / PREDICTIONS, main)
    run.write_comparison(to_records(main), META, "tables")
    write_image(path / "stories" / "a.jpg", np.zeros((20, 20, 3), np.uint8))
    shown = [("stories/a.jpg", "caption")]
    write_json(path / STORIES, [Story("oorc", "where", shown)])
    run.finish(META, {"decoding": 1.0}, ["a note"])
