"""Pictures in files as people have them, and what each shows: for the sender and for the page.

Pillow, which reads and writes them in its own way, says what a viewer shows.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import Any

import numpy as np
from PIL import Image, ImageCms, ImageOps

from link.types import Array

SIZE = (96, 64)
P3_RED, P3_RED_IN_SRGB = (200, 60, 40), (217, 42, 23)
"""A red of Display P3 within the colours of sRGB, and the same in sRGB, by the formulas of both."""


@dataclass(frozen=True)
class Picture:
    """A picture's file and what a viewer shows of it on white."""

    name: str
    data: bytes
    shown: Array
    """(H, W, 3) uint8, encoded sRGB."""
    tolerance: int = 1
    """Largest difference of a level."""


def quarters() -> Image.Image:
    """Four quarters of unlike colours, the first half transparent."""
    image = np.full((SIZE[1], SIZE[0], 4), 255, np.uint8)
    image[:32, :48, :3], image[:32, 48:, :3] = (200, 0, 0), (0, 200, 0)
    image[32:, :48, :3], image[32:, 48:, :3] = (0, 0, 200), (90, 90, 90)
    image[4:28, 4:44, 3] = 64
    return Image.fromarray(image)


def saved(image: Image.Image, kind: str, **how: Any) -> bytes:
    """The bytes of an image's file."""
    file = BytesIO()
    image.save(file, kind, **how)
    return file.getvalue()


def turned_pictures() -> Iterator[Picture]:
    """Each EXIF orientation, with and without transparency, in PNG, WebP and JPEG."""
    for kind in ("png", "webp", "jpeg"):
        for lies in range(1, 9):
            for mode in ("RGB",) if kind == "jpeg" else ("RGB", "RGBA"):
                exif = Image.Exif()
                exif[0x112] = lies
                how = {"lossless": True} if kind == "webp" else {}
                how |= {"quality": 100, "subsampling": 0} if kind == "jpeg" else {}
                data = saved(quarters().convert(mode), kind, exif=exif, **how)
                read = Image.open(BytesIO(data))
                upright = ImageOps.exif_transpose(read).convert("RGBA")
                on_white = Image.new("RGBA", upright.size, "white")
                on_white.alpha_composite(upright)
                shown = np.asarray(on_white.convert("RGB"))
                yield Picture(f"{mode}-{lies}.{kind}", data, shown, 3 if kind == "jpeg" else 1)


def display_p3() -> bytes:
    """An ICC profile with the colours of Display P3 and the tone curve of sRGB."""
    whole = bytearray(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
    primaries = {  # of Display P3, adapted to D50, in ICC's 16.16 numbers
        b"rXYZ": (0.51512, 0.24120, -0.00105),
        b"gXYZ": (0.29198, 0.69225, 0.04189),
        b"bXYZ": (0.15710, 0.06657, 0.78407),
    }
    count = int.from_bytes(whole[128:132], "big")
    for at in range(132, 132 + 12 * count, 12):
        place = int.from_bytes(whole[at + 4 : at + 8], "big")
        if (xyz := primaries.get(bytes(whole[at : at + 4]))) is not None:
            numbers = np.round(65536 * np.array(xyz)).astype(">i4")
            whole[place + 8 : place + 20] = numbers.tobytes()
    return bytes(whole).replace(
        "sRGB built-in".encode("utf-16-be"), "P3 for a test".encode("utf-16-be")
    )


def profiled_pictures() -> Iterator[Picture]:
    """Pictures with a profile of Display P3, and with one of sRGB itself."""
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    for kind in ("png", "webp", "jpeg"):
        how = {"lossless": True} if kind == "webp" else {"quality": 100, "subsampling": 0}
        for name, profile, shown in (
            ("p3", display_p3(), P3_RED_IN_SRGB),
            ("srgb", srgb, P3_RED),
        ):
            data = saved(Image.new("RGB", SIZE, P3_RED), kind, icc_profile=profile, **how)
            whole = np.full((SIZE[1], SIZE[0], 3), shown, np.uint8)
            yield Picture(f"{name}.{kind}", data, whole, 3)
