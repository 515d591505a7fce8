"""Annotated pictures of a folder of captures, one for each frame pair and method."""

from pathlib import Path

from link.captures import load_capture, read_manifest
from link.errors import UnsuitedError
from link.images import write_image
from reports.engine.methods import Method
from reports.render.figures import annotate


def write_annotated(captures: Path, methods: list[Method], folder: Path) -> None:
    """Decode a folder of captures and write an annotated picture of each frame pair and method.

    Args:
        captures: folder with a manifest.
        methods: what decodes; a method that cannot decode such captures is passed over.
        folder: gets the pictures, as PNG.
    """
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
