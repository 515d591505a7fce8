"""Read and write images: RGB arrays inside, and one clear line when a file is no good."""

import os
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError

MIN_SIDE_PX = 16
"""Smallest width and height, in pixels, of an image that is read."""
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
"""Endings, in lower case, of the files that count as images where a folder is listed."""
LUMA = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in the luma of an encoded image (ITU-R BT.601)."""


def intensity(frame: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Take the luma of an RGB frame, or a gray frame as it is.

    Args:
        frame: (H, W) or (H, W, 3) uint8, encoded.

    Returns:
        (H, W) float32 in [0, 1], encoded.

    >>> intensity(np.full((1, 2), 51, np.uint8))
    array([[0.2, 0.2]], dtype=float32)
    """
    scaled = frame.astype(np.float32) / np.float32(255)
    luma = np.array(LUMA, np.float32)
    return np.asarray(scaled if frame.ndim == 2 else scaled @ luma, np.float32)


def read_image(path: Path | str) -> NDArray[np.uint8]:
    """Read an image file as encoded RGB.

    16-bit files are reduced to 8 bits, gray files repeated over three channels, and the EXIF
    orientation is applied.

    Returns:
        (H, W, 3) uint8, encoded, RGB.

    Raises:
        InputError: the file is missing, is not an image, or is smaller than 16 x 16.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such image file; check the path")
    data = path.read_bytes()
    if _is_cut_off(data):
        raise InputError(f"{path}: not a readable image: it is cut off; copy it again")
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) if data else None
    except cv2.error:
        image = None
    if image is None:
        raise InputError(f"{path}: not a readable image; give a PNG, JPEG, TIFF or BMP file")
    height, width = image.shape[:2]
    if min(height, width) < MIN_SIDE_PX:
        raise InputError(
            f"{path}: image is {width}x{height}, need at least {MIN_SIDE_PX}x{MIN_SIDE_PX} pixels"
        )
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def _is_cut_off(data: bytes) -> bool:
    """Whether a PNG or JPEG lacks its end, which OpenCV would fill with gray."""
    if data.startswith(b"\x89PNG"):
        return b"IEND" not in data[-64:]
    if data.startswith(b"\xff\xd8"):  # an end marker in the first half is that of a thumbnail
        return data.rfind(b"\xff\xd9") < len(data) // 2
    return False


def as_rgb(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Repeat a gray frame over three channels: (H, W) or (H, W, 3) becomes (H, W, 3)."""
    return frame if frame.ndim == 3 else np.repeat(frame[:, :, None], 3, axis=2)


def as_batch(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Arrange a frame as the decoder's graph takes it.

    Args:
        frame: (H, W) or (H, W, 3) uint8, encoded.

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
        width: of the result, pixels.
        height: of the result, pixels.

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
        ok, data = cv2.imencode(path.suffix, bgr)
    except cv2.error:
        ok = False
    if not ok:
        raise InputError(f"{path}: cannot write images of type {path.suffix!r}; use .png or .jpg")
    write_bytes(path, data.tobytes())


def write_bytes(path: Path | str, data: bytes) -> None:
    """Write a file under a temporary name and rename it, so that a reader never sees half.

    Raises:
        InputError: the folder cannot be made or written.
    """
    path = Path(path)
    make_folder(path.parent)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror})") from None


def make_folder(path: Path) -> None:
    """Make a folder and its parents, or raise an `InputError` that names it."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be made a folder ({error.strerror})") from None
