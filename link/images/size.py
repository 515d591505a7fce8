"""What an image's file says of it, read before any pixel is decoded: above all its size.

OpenCV decodes a whole image before it tells the size, and a PNG of 3 MB can hold 900 million
pixels. So the header is read here: PNG, JPEG, BMP, TIFF and WebP, the kinds of
`link.images.IMAGE_SUFFIXES`.
"""

import re
import struct
from collections.abc import Iterator

PNG, JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"
"""First bytes of PNG and of JPEG files."""
START_OF_FRAME = {0xC0, 0xC1, 0xC2, 0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF}
"""Second bytes of the JPEG markers that begin with the size (ITU-T T.81, table B.1)."""
START_OF_SCAN = 0xDA
"""Second byte of the JPEG marker behind which compressed pixels begin."""
END_OF_IMAGE = 0xD9
"""Second byte of the JPEG marker at the end."""
STANDALONE = {0x01, *range(0xD0, 0xD9)}
"""Second bytes of the JPEG markers that no length follows."""
IN_SCANS = re.compile(rb"\xff+[^\x00\xd0-\xd7\xff]")
"""Pattern of a JPEG marker behind the first scan; pixels hold FF only before 00 or a restart."""
MAX_SCANS = 100
"""Largest number of scans of a JPEG file. Each scan passes over all pixels; usual are 1 to 12."""
MAX_PIXEL_BYTES = 16
"""Largest number of compressed bytes of a PNG file for each pixel, twice what the largest pixels
take without compression."""
WEBP_ANIMATION, WEBP_ALPHA = 2, 16
"""Bits of an extended WebP file's flags that an animation sets, and transparency."""
PNG_ALPHA = (4, 6)
"""Numbers of the kinds of PNG pixels that say how transparent they are."""
UNREAD_BRANDS = {b"heic": "HEIC", b"heix": "HEIC", b"mif1": "HEIC", b"avif": "AVIF"}
"""By the brand in a file's first bytes, kinds of pictures that are not read."""
SPARE_PIXELS = 4096
"""Number of pixels by which a PNG file may seem larger than it is, so that small ones pass."""
TIFF_WIDTH, TIFF_HEIGHT = 256, 257
"""Tags of a TIFF directory that give the size."""
ORIENTATION = 274
"""Tag of a TIFF directory, which EXIF is, that says how the stored image lies."""
TIFF_NUMBERS = {1: "B", 3: "H", 4: "I", 16: "Q"}
"""Letters of `struct` for TIFF's types of whole numbers."""


def image_size(data: bytes) -> tuple[int, int] | None:
    """Read width and height, in pixels, from the bytes of an image file.

    Args:
        data: the file, from its first byte; what follows the header is not looked at.

    Returns:
        width and height as stored, before a turn that EXIF may ask for. None where the bytes are no
        PNG, JPEG, BMP, TIFF or WebP file, or end before they tell.

    >>> image_size(b"BM" + bytes(12) + struct.pack("<Iii", 40, 640, -480))
    (640, 480)
    """
    try:
        if data.startswith(PNG):
            return struct.unpack_from(">II", data, 16) if data[12:16] == b"IHDR" else None
        if data.startswith(JPEG):
            return _jpeg_size(data)
        if data.startswith(b"BM"):
            return _bmp_size(data)
        if data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            return _tiff_size(data)
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return _webp_size(data)
    except (struct.error, IndexError):
        pass
    return None


def ends_early(data: bytes) -> bool:
    """Whether a PNG or JPEG file lacks its end; OpenCV would fill what is missing with gray.

    A part of a PNG file that is longer than the file counts as such, because OpenCV takes as much
    memory as a part says it has. What follows the end, such as padding or another program's notes,
    does not matter.
    """
    if data.startswith(PNG[:4]):
        return not _png_ends(data)
    if data.startswith(JPEG):
        scan = _jpeg_marker(data, {START_OF_SCAN})
        return scan is None or data.find(b"\xff\xd9", scan) < 0
    return False


def is_overfull(data: bytes, width: int, height: int) -> bool:
    """Whether a PNG or JPEG file holds far more than its pixels, which would keep a reader busy.

    A JPEG file of 1 MB can repeat a scan of 50 million pixels ten thousand times, and a PNG file of
    1 MB can hold 1 GB behind its last row. Readers go through all of it.

    Args:
        data: the file, which does not end early (`ends_early`).
        width: width of the image in pixels, as `image_size` gives it.
        height: height of the image in pixels.
    """
    if data.startswith(PNG):
        compressed = sum(length for name, length, _ in _png_chunks(data) if name == b"IDAT")
        return compressed > MAX_PIXEL_BYTES * (width * height + SPARE_PIXELS)
    return data.startswith(JPEG) and _jpeg_scans(data) > MAX_SCANS


def is_animated(data: bytes) -> bool:
    """Whether a PNG or WebP file says that it holds several pictures, which follow one another."""
    if data.startswith(PNG):
        return any(name == b"acTL" for name, *_ in _png_chunks(data))
    return data[8:16] == b"WEBPVP8X" and bool(data[20:21] and data[20] & WEBP_ANIMATION)


def may_be_transparent(data: bytes) -> bool:
    """Whether a PNG or WebP file says that it tells how transparent its pixels are."""
    if data.startswith(PNG):
        told = any(name == b"tRNS" for name, *_ in _png_chunks(data))
        return told or bool(data[25:26] and data[25] in PNG_ALPHA)
    kind = data[8:16]
    if kind == b"WEBPVP8L":
        return bool(data[24:25] and data[24] & WEBP_ALPHA)
    return kind == b"WEBPVP8X" and bool(data[20:21] and data[20] & WEBP_ALPHA)


def orientation(data: bytes) -> int | None:
    """Read from the EXIF data of a PNG or WebP file how its image lies.

    Returns:
        1 to 8, as EXIF counts, 1 where the file says nothing; None for files of other kinds, whose
        images OpenCV turns.
    """
    if data.startswith(PNG):
        chunks = _png_chunks(data)
    elif data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        chunks = _webp_chunks(data)
    else:
        return None
    for name, length, at in chunks:
        if name in (b"eXIf", b"EXIF"):
            exif = data[at : at + length].removeprefix(b"Exif\0\0")
            try:
                found = _tiff_tags(exif, {ORIENTATION}).get(ORIENTATION, 1)
            except struct.error:
                return 1
            return found if 1 <= found <= 8 else 1
    return 1


def unread_kind(data: bytes) -> str | None:
    """Name the kind of a picture that is not read: HEIC, AVIF or SVG; None for all else.

    >>> unread_kind(bytes(4) + b"ftypheic"), unread_kind(b"<svg/>"), unread_kind(PNG)
    ('HEIC', 'SVG', None)
    """
    if data[4:8] == b"ftyp":
        return UNREAD_BRANDS.get(data[8:12])
    begins = data[:1000].removeprefix(b"\xef\xbb\xbf").lstrip()
    return "SVG" if begins.startswith(b"<") and b"<svg" in begins else None


def _jpeg_scans(data: bytes) -> int:
    """The number of scans of a JPEG file, counted no further than one beyond `MAX_SCANS`."""
    at, scans = _jpeg_marker(data, {START_OF_SCAN}), 0
    while at is not None and scans <= MAX_SCANS:
        marker = IN_SCANS.search(data, at)
        if marker is None or data[marker.end() - 1] == END_OF_IMAGE:
            break
        scans += data[marker.end() - 1] == START_OF_SCAN
        at = marker.end() + int.from_bytes(data[marker.end() : marker.end() + 2], "big")
    return scans


def _png_chunks(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Name, length and place of the content of each chunk that a PNG file could hold."""
    at = len(PNG)
    while at + 12 <= len(data):  # each has a length, a name, content, and a checksum
        name, length = data[at + 4 : at + 8], int.from_bytes(data[at : at + 4], "big")
        yield name, length, at + 8
        if name == b"IEND":
            break
        at += 12 + length


def _png_ends(data: bytes) -> bool:
    """Whether the chunks of a PNG file, one after the other, lead to its end."""
    return any(name == b"IEND" for name, *_ in _png_chunks(data))


def _jpeg_marker(data: bytes, wanted: set[int]) -> int | None:
    """The place of the first of some markers before the pixels; segments are skipped whole."""
    at = 2
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            at += 1
        elif data[at + 1] in wanted:
            return at
        elif data[at + 1] == 0xFF or data[at + 1] in STANDALONE or not data[at + 1]:
            at += 1 if data[at + 1] == 0xFF else 2
        elif data[at + 1] in (START_OF_SCAN, END_OF_IMAGE):
            return None
        else:
            at += 2 + max(2, int.from_bytes(data[at + 2 : at + 4], "big"))
    return None


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    at = _jpeg_marker(data, START_OF_FRAME)
    if at is None:
        return None
    height, width = struct.unpack_from(">HH", data, at + 5)
    return width, height


def _bmp_size(data: bytes) -> tuple[int, int]:
    (header,) = struct.unpack_from("<I", data, 14)
    width, height = struct.unpack_from("<HH" if header == 12 else "<ii", data, 18)
    return abs(width), abs(height)


def _tiff_size(data: bytes) -> tuple[int, int] | None:
    found = _tiff_tags(data, {TIFF_WIDTH, TIFF_HEIGHT})
    return (found[TIFF_WIDTH], found[TIFF_HEIGHT]) if len(found) == 2 else None


def _tiff_tags(data: bytes, wanted: set[int]) -> dict[int, int]:
    """The largest whole number of each wanted tag of the first directory of a TIFF file."""
    order, big = "<" if data[:2] == b"II" else ">", 43 in data[2:4]
    (start,) = struct.unpack_from(f"{order}{'Q' if big else 'I'}", data, 8 if big else 4)
    (count,) = struct.unpack_from(f"{order}{'Q' if big else 'H'}", data, start)
    first, length, value = (start + 8, 20, 12) if big else (start + 2, 12, 8)
    found: dict[int, int] = {}
    for entry in range(first, first + length * min(count, 4096), length):
        tag, kind = struct.unpack_from(f"{order}HH", data, entry)
        if tag in wanted and kind in TIFF_NUMBERS:
            (number,) = struct.unpack_from(f"{order}{TIFF_NUMBERS[kind]}", data, entry + value)
            found[tag] = max(found.get(tag, 0), number)
        if len(found) == len(wanted) and tag > max(wanted):
            break
    return found


def _webp_chunks(data: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Name, length and place of the content of each chunk of a WebP file."""
    at = 12
    while at + 8 <= len(data):
        length = int.from_bytes(data[at + 4 : at + 8], "little")
        yield data[at : at + 4], length, at + 8
        at += 8 + length + length % 2


def _webp_size(data: bytes) -> tuple[int, int] | None:
    kind = data[12:16]
    if kind == b"VP8X" and len(data) >= 30:  # the canvas: width and height less one, 24 bits each
        return (
            1 + int.from_bytes(data[24:27], "little"),
            1 + int.from_bytes(data[27:30], "little"),
        )
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    if kind == b"VP8L":
        (packed,) = struct.unpack_from("<I", data, 21)
        return 1 + (packed & 0x3FFF), 1 + (packed >> 14 & 0x3FFF)
    return None
