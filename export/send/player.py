"""Write a loop as one HTML file that plays it in any browser, refresh by refresh."""

import base64
import json
from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError
from link.frames import Displayed
from link.images import write_bytes

TEMPLATE = Path(__file__).with_name("player.html")
"""Page of the player, with `__LOOP__` where the loop goes as JSON."""
MAX_DECODED_BYTES = 2**30
"""Largest memory for all images as a browser holds them, at 4 bytes a pixel."""


def write_player(path: Path, pairs: Iterable[Displayed], hold: int, scale: int = 0) -> None:
    """Write the player, one HTML file that needs no other.

    It holds each original frame once, and for each frame pair an image of the levels that the
    embedded frame adds to it, and one of the levels that it takes away, if any; the browser adds
    and takes them. Images are PNG without colour chunks.

    Args:
        path: the .html file.
        pairs: at least one, (height, width, 3) or (height, width), all of one size.
        hold: refreshes for which each state stays, at least 1.
        scale: display pixels for each picture pixel and axis; 0 for the largest that fits.

    Raises:
        InputError: more pixels than a browser can be asked to hold, or the file is not writable.
    """
    images: dict[bytes, int] = {}
    pngs: list[bytes] = []
    order, shape = [], (0, 0)
    for pair in pairs:
        change = pair.embedded.astype(np.int16) - pair.original
        shown = [pair.original, _gray_where_alike(np.maximum(change, 0))]
        if (change < 0).any():
            shown.append(_gray_where_alike(np.maximum(-change, 0)))
        numbers = []
        for image in shown:
            key = sha256(image.tobytes()).digest()
            if key not in images:
                images[key] = len(pngs)
                pngs.append(_png(image))
            numbers.append(images[key])
        order.append(numbers)
        shape = pair.layout.height, pair.layout.width
        if 4 * len(pngs) * shape[0] * shape[1] > MAX_DECODED_BYTES:
            raise InputError(
                f"the player has more than {MAX_DECODED_BYTES >> 20} MiB of pixels; "
                "write a video, or use fewer pictures or a smaller width and height"
            )
    loop = {
        "width": shape[1],
        "height": shape[0],
        "hold": hold,
        "scale": scale,
        "pairs": order,
        "images": [f"data:image/png;base64,{base64.b64encode(png).decode()}" for png in pngs],
    }
    page = TEMPLATE.read_text("utf-8").replace("__LOOP__", json.dumps(loop), 1)
    write_bytes(path, page.encode())


def _gray_where_alike(levels: NDArray[np.int16]) -> NDArray[np.uint8]:
    """Levels of [0, 255] as an image, (H, W) where all channels are alike, which is smaller."""
    image = levels.astype(np.uint8)
    alike = image.ndim == 3 and bool((image == image[:, :, :1]).all())
    return np.ascontiguousarray(image[:, :, 0]) if alike else image


def _png(image: NDArray[np.uint8]) -> bytes:
    bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, data = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return bytes(data)
