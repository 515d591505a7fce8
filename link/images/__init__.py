"""Read and write images: RGB arrays inside, and one clear line when a file is no good."""

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError, ParameterError
from link.images.size import (
    ends_early,
    image_size,
    is_animated,
    is_overfull,
    may_be_transparent,
    orientation,
    unread_kind,
)
from link.outside import is_file, is_no_file, read_bounded
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
AXES_TO_FLIP: dict[int, tuple[int, ...]] = {
    **{1: (), 2: (1,), 3: (0, 1), 4: (0,)},
    **{5: (), 6: (1,), 7: (0, 1), 8: (0,)},
}
"""Axes along which a stored image is mirrored, by its EXIF orientation; from 5 on it is transposed
before."""
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


def pixel_limit(max_megapixels: float | None = None) -> int:
    """Find the largest number of pixels of an image or a video frame that is read.

    Args:
        max_megapixels: the limit in millions of pixels; where it is None, that of the environment
            variable `MEGAPIXELS_VARIABLE`, and where that is absent `MAX_MEGAPIXELS`.

    Raises:
        InputError: the limit is no number above 0.

    >>> pixel_limit(0.5)
    500000
    """
    given = os.environ.get(MEGAPIXELS_VARIABLE, MAX_MEGAPIXELS)
    try:
        limit = float(given if max_megapixels is None else max_megapixels)
    except ValueError:
        limit = math.nan
    if not 0 < limit <= 1e6:
        shown = given if max_megapixels is None else max_megapixels
        problem = f"need millions of pixels above 0, such as 50, got {shown}"
        if max_megapixels is None:
            raise InputError(f"{MEGAPIXELS_VARIABLE}: {problem:.100}")
        raise ParameterError("max_megapixels", problem)
    return int(limit * 1e6)


def check_pixels(width: int, height: int, where: Path | str, limit: int) -> None:
    """Raise an `InputError` that names the file where an image has more pixels than a limit."""
    if width * height > limit:
        raise InputError(
            f"{where}: image is {width}x{height}, more than {limit / 1e6:g} megapixels; scale it "
            f"down, or raise the limit with --max-megapixels or {MEGAPIXELS_VARIABLE}"
        )


def read_image(path: Path | str, max_megapixels: float | None = None) -> NDArray[np.uint8]:
    """Read an image file as encoded RGB, as `read_picture` does."""
    return read_picture(path, max_megapixels)[0]


def read_picture(
    path: Path | str, max_megapixels: float | None = None
) -> tuple[NDArray[np.uint8], bool]:
    """Read an image file as encoded RGB, and say whether parts of it are transparent.

    What is transparent in a PNG or WebP file is laid on white. 16-bit files are reduced to 8 bits,
    gray files repeated over three channels, and the EXIF orientation is applied. The size is read
    from the header before any pixel is decoded.

    Args:
        path: a PNG, JPEG, TIFF, BMP or WebP file.
        max_megapixels: largest number of pixels, in millions; see `pixel_limit`.

    Returns:
        (H, W, 3) uint8, encoded, RGB, and whether white shows through.

    Raises:
        InputError: the file is missing, is not an image or an animated one, has too many pixels, or
            is smaller than 16 x 16.
    """
    path, limit = Path(path), pixel_limit(max_megapixels)
    if not is_file(path):
        raise InputError(f"{path}: no such image file; check the path")
    data = read_bounded(path, BYTES_PER_PIXEL * limit + SPARE_BYTES)
    check_kind(path, data)
    if ends_early(data):
        raise InputError(f"{path}: not a readable image: it is cut off; copy it again")
    if is_animated(data):
        raise InputError(f"{path}: an animation; save one picture of it, or all as GIF or video")
    size = image_size(data)
    image, see_through = None, False
    if size is not None:
        check_pixels(*size, path, limit)
        if is_overfull(data, *size):
            raise InputError(
                f"{path}: not a readable image: it holds more than an image of {size[0]}x{size[1]} "
                "has; save it again"
            )
        try:
            image, see_through = _decoded(data)
        except cv2.error:
            image = None
    if image is None:
        raise InputError(f"{path}: not a readable image; give a PNG, JPEG, TIFF, BMP or WebP file")
    height, width = image.shape[:2]
    if min(height, width) < MIN_SIDE_PX:
        raise InputError(
            f"{path}: image is {width}x{height}, need at least {MIN_SIDE_PX}x{MIN_SIDE_PX} pixels"
        )
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8), see_through


def check_kind(path: Path | str, data: bytes) -> None:
    """Raise an `InputError` where a file's first bytes are those of a kind that is not read."""
    kind = unread_kind(data)
    if kind is not None:
        raise InputError(f"{path}: {kind} is not read; save it as JPEG or PNG")


def _decoded(data: bytes) -> tuple[NDArray[np.uint8] | None, bool]:
    """Decode an image file, as a viewer shows it on white.

    Returns:
        (H, W, 3) uint8 as OpenCV orders colours, or None where it cannot be read; and whether
        white shows through.
    """
    encoded, lies = np.frombuffer(data, np.uint8), orientation(data)
    whole = cv2.imdecode(encoded, cv2.IMREAD_UNCHANGED) if may_be_transparent(data) else None
    if whole is not None and whole.ndim == 3 and whole.shape[2] == 4:
        most = np.iinfo(whole.dtype).max
        alpha, image = whole[:, :, 3], (whole[:, :, :3] // (most // 255)).astype(np.uint8)
        seen = alpha < most
        covers = alpha[seen, None].astype(np.float32) / most
        image[seen] = np.rint(255 + covers * (image[seen].astype(np.float32) - 255))
        return _turned(image, lies or 1), bool(seen.any())
    if lies is None:
        return cv2.imdecode(encoded, cv2.IMREAD_COLOR), False
    image = cv2.imdecode(encoded, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    return None if image is None else _turned(image, lies), False


def _turned(image: NDArray[np.uint8], lies: int) -> NDArray[np.uint8]:
    """Turn and mirror a stored image as its EXIF orientation, 1 to 8, says."""
    upright = image.swapaxes(0, 1) if lies > 4 else image
    return np.ascontiguousarray(np.flip(upright, AXES_TO_FLIP[lies]))


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
