"""Find the display in photographs.

python -m receiver.locate IMAGE... [--model MODEL | --layout FILE] [--show DIR]
"""

import json
import sys
from pathlib import Path
from typing import Any

from link.cli import Parser, add_pixel_limit, check_flags, print_error, run_cli
from link.errors import InputError
from link.images import pixel_limit, write_image
from link.images.files import read_image
from link.layout import Layout, read_layout
from link.overlay import outline_display
from models import find_graph
from receiver.locate.find import locate


def layout_of(model: Path | None, file: Path | None) -> Layout | None:
    """Take the layout from --model or --layout; None where neither is given.

    Raises:
        InputError: the file cannot be read, or holds no layout.
    """
    if model is not None:
        from export.runtime import Decoder  # onnxruntime is needed for this flag alone

        return Decoder(model).layout
    return None if file is None else read_layout(file)


def main() -> None:
    """Print where the display is, one JSON line an image."""
    parser = Parser(prog="python -m receiver.locate", description=main.__doc__)
    parser.add_argument("images", type=Path, nargs="+", metavar="IMAGE")
    known = parser.add_mutually_exclusive_group()
    known.add_argument(
        "--model", type=find_graph, help="an .onnx decoder, which carries its layout, or a preset"
    )
    known.add_argument("--layout", type=Path, help="a JSON file with the layout, or sent.json")
    add_pixel_limit(parser)
    parser.add_argument("--show", type=Path, metavar="DIR", help="write images with the outline")
    args = check_flags(parser.parse_args())
    pixel_limit()  # a wrong limit is no error of each image
    layout, failed = layout_of(args.model, args.layout), False
    shown = [] if args.show is None else [args.show / f"{path.stem}.png" for path in args.images]
    given, written = ({path.resolve() for path in paths} for paths in (args.images, shown))
    if len(written) < len(shown) or given & written:
        raise InputError("--show: two images would have one name there; name another folder")
    for number, path in enumerate(args.images):
        try:
            image = read_image(path)
        except InputError as error:
            print_error(str(error))
            failed = True
            continue
        found = locate(image, layout)
        result: dict[str, Any] = {"image": str(path), "corners": None, "score": None}
        if found is not None:
            result["corners"] = found.corners.round(2).tolist()
            result["score"] = round(found.score, 4)
        print(json.dumps(result), flush=True)
        if args.show is not None:
            drawn = outline_display(image, None if found is None else found.corners)
            write_image(shown[number], drawn)
    if failed:
        sys.exit(2)


if __name__ == "__main__":
    run_cli(main)
