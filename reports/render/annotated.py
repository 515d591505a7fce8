"""One annotated picture a frame pair and method of a folder of captures."""

from pathlib import Path

from link.captures import load_capture, read_manifest
from link.errors import UnsuitedError
from link.images import write_image
from reports.engine.methods import Method
from reports.render.figures import annotate


def show(captures: Path, methods: list[Method], folder: Path) -> None:
    """Write one annotated picture a frame pair and method."""
    for number, entry in enumerate(read_manifest(captures)):
        captured = load_capture(captures, entry)
        pair = captured.rectified()
        for method in methods:
            try:
                soft = method.build().decode(pair)
            except UnsuitedError:
                continue
            picture = annotate(pair, soft, captured.bits)
            write_image(folder / f"{number:05d}_{method.name}.png", picture)
    print(f"annotated pictures: {folder}")
