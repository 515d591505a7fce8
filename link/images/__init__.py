"""Images as arrays, and how they are written; `link.images.files` reads them."""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError
from link.outside import is_file, is_no_file
from link.types import Image

MIN_SIDE_PX = 16
"""Smallest width and height, in pixels, of an image that is read."""
MAX_MEGAPIXELS = 50.0
"""Largest number of pixels, in millions, of an image or a video frame that is read, unless
`MEGAPIXELS_VARIABLE` says otherwise."""
MEGAPIXELS_VARIABLE = "OORC_MAX_MEGAPIXELS"
"""Name of the environment variable that holds another limit in place of `MAX_MEGAPIXELS`."""
BYTES_PER_PIXEL = 8
"""Largest size of a stored pixel, in bytes: four channels of 16 bits, without compression."""
SPARE_BYTES = 2**24
"""Largest size, in bytes, of what an image file may hold beside its pixels, such as a profile."""
MAX_NAME_BYTES = 255
"""Largest length, in bytes, of a file's name on the usual file systems."""
UNREAD_BRANDS = {b"heic": "HEIC", b"heix": "HEIC", b"mif1": "HEIC", b"avif": "AVIF"}
"""Kinds of pictures that cannot be read, by the brand in a file's first bytes."""
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
"""Endings, in lower case, of the files that count as images where a folder is listed."""
LUMA = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in the luma of an encoded image (ITU-R BT.601)."""
if "OPENCV_LOG_LEVEL" not in os.environ:  # our one line says what is wrong
    # 0 is silent; cv2.utils.logging came with 4.13, and OpenCV 5 has it alone
    (getattr(cv2, "setLogLevel", None) or cv2.utils.logging.setLogLevel)(0)


def as_gray(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Turn an image into its luma.

    Args:
        image: (H, W) uint8, which stays as it is, or (H, W, 3) uint8, encoded RGB.

    Returns:
        (H, W) uint8, encoded.

    >>> as_gray(np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255]]], np.uint8)).tolist()
    [[76, 150, 29]]
    """
    return np.asarray(
        image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8
    )


def averaged_down(image: Image, factor: int) -> Image:
    """Average squares of pixels; rows and columns beyond the last whole square are left out.

    >>> averaged_down(np.array([[0, 4, 9], [8, 12, 9]], np.uint8), 2).tolist()
    [[6]]
    """
    rows, cols = (side // factor for side in image.shape[:2])
    whole = image[: rows * factor, : cols * factor]
    return np.asarray(cv2.resize(whole, (cols, rows), interpolation=cv2.INTER_AREA), np.uint8)


def intensity(frame: Image) -> NDArray[np.float32]:
    """Take the luma of an RGB frame, or a gray frame as it is.

    Args:
        frame: an `Image`.

    Returns:
        (H, W) float32 in [0, 1], encoded.

    >>> intensity(np.full((1, 2), 51, np.uint8))
    array([[0.2, 0.2]], dtype=float32)
    """
    scaled = frame.astype(np.float32) / np.float32(255)
    if frame.ndim == 2:
        return scaled
    return np.asarray(scaled @ np.array(LUMA, np.float32), np.float32)


def pixel_limit() -> int:
    """Find the largest number of pixels of an image or a video frame that is read.

    It is that of the environment variable `MEGAPIXELS_VARIABLE`, which the flag --max-megapixels
    sets, and where that is absent `MAX_MEGAPIXELS`.

    Raises:
        InputError: the limit is no number above 0.
    """
    given = os.environ.get(MEGAPIXELS_VARIABLE, MAX_MEGAPIXELS)
    try:
        limit = float(given)
    except ValueError:
        limit = math.nan
    if not 0 < limit <= 1e6:
        problem = f"need millions of pixels above 0, such as 50, got {given}"
        raise InputError(f"{MEGAPIXELS_VARIABLE}: {problem:.100}")
    return int(limit * 1e6)


def check_pixels(width: int, height: int, where: Path | str) -> None:
    """Raise an `InputError` that names the file where an image has more pixels than the limit."""
    limit = pixel_limit()
    if width * height > limit:
        raise InputError(
            f"{where}: image is {width}x{height}, more than {limit / 1e6:g} megapixels; scale it "
            f"down, or raise the limit with --max-megapixels or {MEGAPIXELS_VARIABLE}"
        )


def check_size(width: int, height: int, where: Path | str) -> None:
    """Raise an `InputError` that names the file where an image has too many pixels, or too few."""
    check_pixels(width, height, where)
    if min(width, height) < MIN_SIDE_PX:
        need = f"{MIN_SIDE_PX}x{MIN_SIDE_PX}"
        raise InputError(f"{where}: image is {width}x{height}, need at least {need} pixels")


def check_kind(path: Path | str, data: bytes) -> None:
    """Refuse a file whose first bytes are those of a kind that is not read: HEIC, AVIF or SVG.

    Args:
        path: the file, for the message of the error.
        data: its first bytes, or all of them.

    Raises:
        InputError: it is of such a kind.

    >>> check_kind("photo.jpg", bytes(4) + b"ftypheic")
    Traceback (most recent call last):
    ...
    link.errors.InputError: photo.jpg: HEIC is not read; save it as JPEG or PNG
    """
    begins = data[:1000].removeprefix(b"\xef\xbb\xbf").lstrip()
    kind = UNREAD_BRANDS.get(data[8:12]) if data[4:8] == b"ftyp" else None
    if begins.startswith(b"<") and b"<svg" in begins:
        kind = "SVG"
    if kind is not None:
        raise InputError(f"{path}: {kind} is not read; save it as JPEG or PNG")


def as_rgb(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Repeat a gray frame over three channels: (H, W) or (H, W, 3) becomes (H, W, 3)."""
    return frame if frame.ndim == 3 else np.repeat(frame[:, :, None], 3, axis=2)


def as_batch(frame: Image) -> NDArray[np.uint8]:
    """Arrange a frame as the decoder's graph takes it.

    Args:
        frame: an `Image`.

    Returns:
        (1, 3, H, W) uint8, contiguous.
    """
    return np.ascontiguousarray(as_rgb(frame).transpose(2, 0, 1))[None]


def image_files(folder: Path) -> list[Path]:
    """List the images of a folder by name; subfolders, hidden and other files are passed over.

    Raises:
        InputError: the folder holds no image.
    """
    files = sorted(
        file
        for file in folder.iterdir()
        if file.is_file()
        and file.suffix.lower() in IMAGE_SUFFIXES
        and not file.name.startswith(".")
    )
    if not files:
        raise InputError(
            f"{folder}: no image in this folder; looked for {', '.join(IMAGE_SUFFIXES)}"
        )
    return files


def fit_picture(picture: NDArray[np.uint8], width: int, height: int) -> NDArray[np.uint8]:
    """Cut the largest centred window of the wanted aspect and resize it.

    Args:
        picture: (H, W, 3) or (H, W) uint8, encoded.
        width: width of the result, pixels.
        height: height of the result, pixels.

    Returns:
        (height, width, 3) or (height, width) uint8; averaged down (INTER_AREA) or bilinear up.

    >>> fit_picture(np.zeros((60, 200, 3), np.uint8), 32, 24).shape
    (24, 32, 3)
    """
    rows, cols = picture.shape[:2]
    scale = min(cols / width, rows / height)
    window_cols, window_rows = max(1, round(scale * width)), max(1, round(scale * height))
    left, top = (cols - window_cols) // 2, (rows - window_rows) // 2
    window = picture[top : top + window_rows, left : left + window_cols]
    how = cv2.INTER_AREA if scale >= 1 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(window, (width, height), interpolation=how), np.uint8)


def write_image(path: Path | str, image: NDArray[np.uint8]) -> None:
    """Write an encoded RGB (H, W, 3) or gray (H, W) uint8 image; the suffix names the format.

    Raises:
        InputError: the suffix is unknown to OpenCV.
    """
    path = Path(path)
    bgr = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    try:
        ok, data = cv2.imencode(path.suffix.encode(errors="replace").decode(), bgr)
    except cv2.error:
        ok = False
    if not ok:
        raise InputError(f"{path}: cannot write images of type {path.suffix!r}; use .png or .jpg")
    write_bytes(path, data.tobytes())


def write_bytes(path: Path | str, data: bytes) -> None:
    """Write a file as `replaced` does."""
    with replaced(Path(path)) as temporary:
        temporary.write_bytes(data)


@contextmanager
def replaced(path: Path, ending: str = "") -> Iterator[Path]:
    """Lend a temporary name for a file, which gets its own name when the block ends.

    So a reader never sees half a file. Nothing is left where the block fails. Where the name is a
    symbolic link, the link stays, and the file to which it leads is written.

    Args:
        path: the file; its folder is made if it is not there.
        ending: end of the temporary name, for libraries that take a file's kind from it.

    Raises:
        InputError: the folder cannot be made or written, or the name is that of a folder or device.
    """
    place = Path(os.path.realpath(path)) if os.path.islink(path) else path
    temporary = temporary_name(place)
    temporary = temporary.with_name(temporary.name + ending)
    if is_no_file(place) or os.path.islink(place):
        raise InputError(f"{path}: is a folder or a device; name a file")
    make_folder(place.parent)
    try:
        yield temporary
        temporary.replace(place)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None
    finally:  # an interrupt, too, leaves nothing behind
        if is_file(temporary):
            temporary.unlink()


def temporary_name(path: Path) -> Path:
    """Name a temporary file beside a file, under which it is written at first.

    Raises:
        InputError: the path has no name, such as that of the root.

    >>> temporary_name(Path("runs/film.mkv")).name.startswith(".film.mkv.")
    True
    """
    if not path.name:
        raise InputError(f"{path}: is a folder; name a file")
    short = len(os.fsencode(path.name)) < MAX_NAME_BYTES - 30
    return path.with_name(f".{path.name if short else path.name[:50]}.{os.getpid()}.tmp")


def make_folder(path: Path) -> None:
    """Make a folder and its parents, or raise an `InputError` that names it."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be made a folder ({error.strerror})") from None
