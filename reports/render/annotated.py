"""Annotated pictures of a folder of captures, one for each capture and method."""

from pathlib import Path

from link.captures import KnownWindow, read_manifest
from link.errors import UnsuitedError
from link.images import write_image
from reports.captured.receive import pair_of_window
from reports.engine.methods import Method
from reports.render.figures import annotate


def write_annotated(captures: Path, methods: list[Method], folder: Path) -> None:
    """Decode a folder of captures and write an annotated picture of each capture and method.

    Of a window of film, the frame pair in its middle is decoded, put together from its frames.

    Args:
        captures: folder with a manifest.
        methods: what decodes; a method that cannot decode such captures is passed over.
        folder: gets the pictures, as PNG.
    """
    for number, entry in enumerate(read_manifest(captures)):
        captured = entry.load()
        if isinstance(captured, KnownWindow):
            captured = pair_of_window(captured, captured.observation.mixture.count // 2)
        pair = captured.rectified()
        for method in methods:
            try:
                soft = method.build().decode(pair)
            except UnsuitedError:
                continue
            picture = annotate(pair, soft, captured.bits)
            write_image(folder / f"{number:05d}_{method.name}.png", picture)
    print(f"annotated pictures: {folder}")
