"""Read image files, with Pillow: RGB arrays inside, and one clear line when a file is no good.

Files may come from strangers. Pillow tells the size before it decodes a pixel, and stops at the
last row; what it does not bound, the scans of a JPEG file, is bounded here.
"""

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from warnings import catch_warnings

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

from link.errors import InputError
from link.images import (
    BYTES_PER_PIXEL,
    SPARE_BYTES,
    check_kind,
    check_size,
    pixel_limit,
)
from link.outside import is_file, read_bounded

Image.MAX_IMAGE_PIXELS = None  # `check_size` is stricter, and says what to do
KINDS = ("PNG", "JPEG", "TIFF", "BMP", "WEBP")
"""Kinds of files that are read, by Pillow's names; those of `link.images.IMAGE_SUFFIXES`."""
START_OF_SCAN, END_OF_IMAGE = b"\xff\xda", b"\xff\xd9"
"""Markers of JPEG before compressed pixels, and at the end; pixels hold neither."""
MAX_SCANS = 100
"""Largest number of scans of a JPEG file. Each scan passes over all pixels; usual are 1 to 12, and
a file of 1 MB could hold ten thousand."""
DEEP_MODES = ("I;16", "I;16B", "I;16L", "I;16N", "I")
"""Pillow's names of gray pixels of 16 bits."""


@dataclass(frozen=True)
class Picture:
    """Pixels and colours of an image file."""

    rgb: NDArray[np.uint8]
    """(H, W, 3) uint8, encoded RGB, upright, laid on white."""
    see_through: bool
    """Whether white shows through."""
    profile: bytes | None
    """The ICC profile of its colours, if the file has one."""


def read_image(path: Path | str) -> NDArray[np.uint8]:
    """Read an image file as encoded RGB, as `read_picture` does."""
    return read_picture(path).rgb


def read_picture(path: Path | str) -> Picture:
    """Read an image file as encoded RGB, with what is special about it.

    What is transparent is laid on white. 16-bit files are reduced to 8 bits, gray files repeated
    over three channels, and the EXIF orientation is applied. The size is read from the header
    before any pixel is decoded.

    Args:
        path: a PNG, JPEG, TIFF, BMP or WebP file.

    Raises:
        InputError: the file is missing, is not an image or an animated one, has too many pixels, or
            is smaller than 16 x 16.
    """
    path = Path(path)
    if not is_file(path):
        raise InputError(f"{path}: no such image file; check the path")
    data = read_bounded(path, BYTES_PER_PIXEL * pixel_limit() + SPARE_BYTES)
    check_kind(path, data)
    try:
        with catch_warnings(action="ignore"), Image.open(BytesIO(data), formats=KINDS) as file:
            check_size(*file.size, path)
            if file.format in ("PNG", "WEBP") and getattr(file, "is_animated", False):
                raise InputError(
                    f"{path}: an animation; save one picture of it, or all as GIF or video"
                )
            if file.format in ("JPEG", "MPO") and file.fp is not None:
                _check_scans(path, data[file.fp.tell() :])
            if file.format == "TIFF" and file.mode in ("I", "F"):
                raise InputError(
                    f"{path}: its white is not known, as its levels have 32 bits or a sign; save "
                    "it with 8 or 16 bits"
                )
            profile = file.info.get("icc_profile")
            rgb, see_through = _on_white(ImageOps.exif_transpose(file))
    except UnidentifiedImageError:
        raise InputError(
            f"{path}: not a readable image; give a PNG, JPEG, TIFF, BMP or WebP file"
        ) from None
    except InputError:
        raise
    except Exception:  # Pillow's readers raise many kinds on damaged files
        raise InputError(
            f"{path}: not a readable image: it is damaged or cut off; copy it again"
        ) from None
    return Picture(rgb, see_through, profile)


def is_picture(path: Path) -> bool:
    """Whether a file begins as one of the kinds of images do that are read."""
    try:
        with catch_warnings(action="ignore"), Image.open(path, formats=KINDS):
            return True
    except Exception:
        return False


def _check_scans(path: Path, compressed: bytes) -> None:
    """Refuse a JPEG file that would keep its decoder busy, from the bytes behind its header."""
    if compressed.count(START_OF_SCAN, 0, compressed.find(END_OF_IMAGE)) >= MAX_SCANS:
        raise InputError(
            f"{path}: not a readable image: it has more than {MAX_SCANS} scans; save it again"
        )


def _on_white(image: Image.Image) -> tuple[NDArray[np.uint8], bool]:
    """Give an image as (H, W, 3) uint8, as a viewer shows it on white, and whether white shows."""
    if image.mode in DEEP_MODES:
        gray = np.clip(np.asarray(image) >> 8, 0, 255).astype(np.uint8)
        return np.repeat(gray[:, :, None], 3, axis=2), False
    if not image.has_transparency_data:
        return np.asarray(image.convert("RGB")), False
    whole = image.convert("RGBA")
    white = Image.new("RGBA", whole.size, "white")
    opaque = Image.alpha_composite(white, whole).convert("RGB")
    return np.asarray(opaque), bool(np.asarray(whole)[:, :, 3].min() < 255)
