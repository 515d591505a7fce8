import json
import struct
import sys
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from conftest import cases, refusal, run_process
from PIL import Image, ImageOps
from tolerances import IDENTITY_LEVELS

from link.captures import MANIFEST, read_manifest, save_captures
from link.errors import InputError
from link.frames import Captured
from link.geometry import frame_corners
from link.images import write_bytes, write_image
from link.images.files import read_image
from link.layout import make_layout

LAYOUT = make_layout(4, 4, 64, 48, ratex=2)
UNKNOWN = Captured(
    original=np.random.default_rng(1).integers(0, 256, (60, 80, 3), np.uint8),
    embedded=np.random.default_rng(2).integers(0, 256, (60, 80, 3), np.uint8),
    layout=LAYOUT,
    corners=frame_corners(64, 48) + 4.1234,
    corners_embedded=frame_corners(64, 48) + 5.25,
)
KNOWN = replace(
    UNKNOWN,
    original=UNKNOWN.embedded[:, ::-1],
    bits=np.array([0, 1, -1, 1, 0, 0, -1, 1, 1, 1, 0, 0, 1, 0]),
    kappa=5,
    meta={"pair": "canon-lg", "view_deg": 30.0, "picture": "photo/coffee/0", "seed": 7},
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_captures(tmp_path, iter([KNOWN, UNKNOWN]))
    return tmp_path


def load(folder: Path) -> list[Captured]:
    return [entry.load() for entry in read_manifest(folder)]


def rewrite(folder: Path, **changes: Any) -> None:
    """Change keys of the first entry of the manifest; ``...`` drops a key."""
    entry = {**read_manifest(folder)[0].content, **changes}
    entry = {key: value for key, value in entry.items() if value is not ...}
    (folder / MANIFEST).write_text(json.dumps(entry) + "\n")


def test_captures_come_back_as_they_were_saved(tmp_path: Path) -> None:
    assert save_captures(tmp_path, iter([KNOWN, UNKNOWN])) == 2
    for saved, loaded in zip([KNOWN, UNKNOWN], load(tmp_path), strict=True):
        assert loaded.original.tobytes() == saved.original.tobytes()
        assert loaded.embedded.tobytes() == saved.embedded.tobytes()
        np.testing.assert_allclose(loaded.corners, saved.corners, atol=0.0005)
        np.testing.assert_allclose(loaded.corners_embedded, saved.corners_embedded, atol=0.0005)
        assert loaded.layout == saved.layout
        assert loaded.kappa == saved.kappa
        assert loaded.meta == saved.meta


@pytest.mark.parametrize("modulation", ["on_off", "antipodal"])
def test_pilots_and_modulation_come_back(tmp_path: Path, modulation: str) -> None:
    layout = make_layout(4, 4, 64, 48, modulation=modulation, pilots=3)
    bits = np.array([0, 1, -1, 1, 0, 0, -1, 1, 1, 1, 0, 0, 1])
    save_captures(tmp_path, iter([replace(KNOWN, layout=layout, bits=bits)]))
    (loaded,) = load(tmp_path)
    assert loaded.layout == layout
    np.testing.assert_array_equal(loaded.bits, bits)
    written = read_manifest(tmp_path)[0].content["layout"]
    assert (written.get("modulation", "on_off"), written["pilots"]) == (modulation, 3)


def test_unknown_bits_are_null_in_the_file_and_minus_one_in_memory(folder: Path) -> None:
    known, unknown = (entry.content for entry in read_manifest(folder))
    assert known["bits"] == [0, 1, None, 1, 0, 0, None, 1, 1, 1, 0, 0, 1, 0]
    assert not {"bits", "kappa"} & set(unknown)
    first, second = load(folder)
    np.testing.assert_array_equal(first.bits, KNOWN.bits)
    assert second.bits is None


def test_a_gray_capture_comes_back_with_three_equal_channels(tmp_path: Path) -> None:
    gray = replace(KNOWN, original=KNOWN.original[:, :, 0], embedded=KNOWN.embedded[:, :, 0])
    save_captures(tmp_path, iter([gray]))
    (loaded,) = load(tmp_path)
    for channel in range(3):
        np.testing.assert_array_equal(loaded.original[:, :, channel], gray.original)


def test_corners_of_the_embedded_frame_default_to_those_of_the_original(folder: Path) -> None:
    rewrite(folder, corners_embedded=...)
    (loaded,) = load(folder)
    np.testing.assert_array_equal(loaded.corners_embedded, loaded.corners)


def test_frames_need_no_sha256(folder: Path) -> None:
    write_image(folder / "00000_embedded.png", UNKNOWN.original)
    rewrite(folder, sha256=...)
    (loaded,) = load(folder)
    np.testing.assert_array_equal(loaded.embedded, UNKNOWN.original)


@pytest.mark.parametrize("first", ["\n", "\ufeff"])
def test_empty_lines_of_a_manifest_and_a_mark_of_utf_8_are_passed_over(
    folder: Path, first: str
) -> None:
    file = folder / MANIFEST
    file.write_text(first + file.read_text().replace("\n", "\n  \n"))
    assert len(load(folder)) == 2


def test_a_folder_without_a_manifest_is_named(tmp_path: Path) -> None:
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(InputError, match=rf"{folder.name}/manifest\.jsonl: not found"):
            read_manifest(folder)


SHA256 = "differs from the manifest's sha256"
FIELDS: list[tuple[dict[str, Any], str]] = [
    ({"layout": None}, "layout"),
    ({"layout": {**LAYOUT.to_dict(), "rows": "4"}}, "layout: rows"),
    ({"layout": {**LAYOUT.to_dict(), "ratex": [[9, 9]]}}, "outside the grid"),
    ({"layout": {**LAYOUT.to_dict(), "pilots": 2}}, "layout: has pilots beside ratex patches"),
    ({"layout": {**LAYOUT.to_dict(), "modulation": "polar"}}, "unknown modulation 'polar'"),
    ({"corners": [[0, 0], [1]]}, "corners"),
    ({"corners_embedded": [["a", "b"]]}, "corners"),
    ({"bits": [0, 1]}, "layout carries 14, the manifest lists 2"),
    ({"bits": [2] * 14}, "bits"),
    ({"view_deg": -90}, "view_deg must be a number below 90, got -90"),
    ({"kappa": 0}, "kappa"),
    ({"kappa": 2.5}, "kappa"),
    ({"kappa": True}, "kappa"),
    *(
        ({key: ...}, f"line 1: lacks {key}")
        for key in ("original", "embedded", "layout", "corners")
    ),
    *(
        ({key: name}, f"line 1, {key}: need the name of a file, got")
        for key in ("original", "embedded")
        for name in ("", 5, "a\0b")
    ),
]
"""Changes of a manifest's first entry, each with what is said of it."""
DOCUMENTS = [
    (b"", ""),
    (b"\xff\xfe\x00\x01", ""),
    (b"original,embedded\n", ""),
    (b'{"original": "a.png"', ""),
    (b"{}\n", ""),
    (b"[]\n", ""),
    (b"\n\n{not json\n", "line 3: not JSON"),
    (b'\n{"view_deg": NaN}', "line 2: need finite numbers"),
    (b'\n{"meta": [{"a": -Infinity}]}', "line 2: need finite numbers"),
    (b'\n{"seed": %s}' % (b"9" * 5000), "line 2: need finite numbers of at most 64 digits"),
    (b'\n{"deep": ' + b"[" * 100_000, "lie more than 32 deep"),
    (b'\n{"picture": "\\ud800"}', "line 2: holds half of a character"),
]
"""Manifests, each with what is said of it besides its name."""


@pytest.mark.parametrize(("changes", "says"), FIELDS, ids=repr)
def test_a_wrong_field_is_named_with_its_manifest(
    folder: Path, changes: dict[str, Any], says: str
) -> None:
    rewrite(folder, **changes)
    said = refusal(lambda: load(folder))
    assert MANIFEST in said and says in said


@pytest.mark.parametrize(("content", "says"), DOCUMENTS, ids=lambda value: str(value)[:20])
def test_a_manifest_that_is_none_is_named(tmp_path: Path, content: bytes, says: str) -> None:
    (tmp_path / MANIFEST).write_bytes(content)
    said = refusal(lambda: read_manifest(tmp_path))
    assert f"{tmp_path.name}/{MANIFEST}" in said and says in said
    assert len(said) < 400


@cases(
    ({"sha256": "0" * 64}, f"00000_original.png or 00000_embedded.png: {SHA256}"),
    ({"original": "00001_original.png"}, f"00000_embedded.png: {SHA256}"),
    ({"embedded": "00001_original.png"}, f"00001_original.png: {SHA256}"),
    ({"corners": [[0, 0], [1, 1]]}, "corners"),
    ({"corners": [[0, 0], [99, 0], [99, 40], [0, 40]]}, "corners"),
    *(
        ({"original": name}, f"{name}: no such image file")
        for name in ("nowhere.png", "a/b.png", "n" * 300)
    ),
)
def test_frames_that_cannot_be_read_are_named(
    changes: dict[str, Any], says: str, folder: Path
) -> None:
    rewrite(folder, **changes)
    assert says in refusal(lambda: load(folder)[0].rectified())


@pytest.mark.parametrize("key", ["original", "embedded"])
@pytest.mark.parametrize("kind", ["absolute", "climbing back", "link", "linked folder"])
def test_a_frame_outside_the_folder_is_refused(folder: Path, kind: str, key: str) -> None:
    outside = folder.parent / f"{folder.name}_outside"
    outside.mkdir()
    write_image(outside / "other.png", UNKNOWN.original)
    (folder / "link.png").symlink_to(outside / "other.png")
    (folder / "linked").symlink_to(outside)
    name = {
        "absolute": str(outside / "other.png"),
        "climbing back": f"../{folder.name}/00000_original.png",
        "link": "link.png",
        "linked folder": "linked/other.png",
    }[kind]
    rewrite(folder, **{key: name})
    said = refusal(lambda: read_manifest(folder))
    assert f"line 1, {key}: " in said and " leads out of" in said


def test_a_folder_and_its_frames_may_be_reached_by_links_that_stay_inside(folder: Path) -> None:
    (folder / "same.png").symlink_to("00000_original.png")
    rewrite(folder, original="same.png")
    linked = folder.parent / f"{folder.name}_linked"
    linked.symlink_to(folder)
    for place in (folder, linked):
        np.testing.assert_array_equal(load(place)[0].original, KNOWN.original)


def test_lines_of_a_manifest_end_at_line_feeds_alone(folder: Path) -> None:
    entry = read_manifest(folder)[0].content | {"picture": "a\u2028b\x85c"}
    (folder / MANIFEST).write_text(json.dumps(entry, ensure_ascii=False) + "\r\n", newline="")
    (loaded,) = load(folder)
    assert loaded.meta["picture"] == "a\u2028b\x85c"


def test_brackets_in_texts_do_not_count_as_depth(folder: Path) -> None:
    rewrite(folder, picture="[" * 100 + '\\"' + "{" * 100)
    assert load(folder)[0].meta["picture"].startswith("[[")


@pytest.mark.parametrize("size", [(15, 200), (200, 15)])
def test_a_tiny_image_is_refused_with_its_size(tmp_path: Path, size: tuple[int, int]) -> None:
    path = tmp_path / "tiny.png"
    write_image(path, np.zeros(size[::-1], np.uint8))
    with pytest.raises(InputError, match=rf"tiny\.png: image is {size[0]}x{size[1]}"):
        read_image(path)


@pytest.mark.parametrize("suffix", [".bmp", ".tiff", ".PNG"])
def test_lossless_files_keep_every_pixel_and_the_order_of_channels(
    tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"picture{suffix}"
    write_image(path, UNKNOWN.original)
    np.testing.assert_array_equal(read_image(path), UNKNOWN.original)
    np.testing.assert_array_equal(np.asarray(Image.open(path)), UNKNOWN.original)


def test_a_16_bit_png_is_reduced_to_8_bits(tmp_path: Path) -> None:
    deep = np.random.default_rng(3).integers(0, 2**16, (20, 30, 3), np.uint16)
    assert cv2.imwrite(str(tmp_path / "deep.png"), deep[:, :, ::-1])
    read = read_image(tmp_path / "deep.png")
    assert read.dtype == np.uint8
    assert np.abs(read - deep / 257).max() <= IDENTITY_LEVELS


@pytest.mark.parametrize("mode", ["L", "LA", "RGBA", "P", "1"])
def test_other_kinds_of_png_become_rgb(tmp_path: Path, mode: str) -> None:
    ramp = np.repeat(np.arange(0, 256, 8, dtype=np.uint8)[None], 20, axis=0)
    image = Image.fromarray(ramp).convert(mode)
    image.save(tmp_path / "picture.png")
    np.testing.assert_array_equal(read_image(tmp_path / "picture.png"), image.convert("RGB"))


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_jpeg_is_turned_as_its_exif_says(tmp_path: Path, orientation: int) -> None:
    y, x = np.mgrid[:48, :64]
    stored = Image.fromarray(np.stack([4 * x, 5 * y, 128 + x - y], axis=2).astype(np.uint8))
    exif = Image.Exif()
    exif[0x0112] = orientation
    stored.save(tmp_path / "turned.jpg", exif=exif, quality=95, subsampling=0)
    upright = np.asarray(ImageOps.exif_transpose(Image.open(tmp_path / "turned.jpg")))
    read = read_image(tmp_path / "turned.jpg")
    assert read.shape == upright.shape
    assert np.abs(read.astype(int) - upright).max() <= 2  # decoders round differently


@pytest.mark.parametrize("name", ["picture.xyz", "picture"])
def test_images_of_unknown_type_are_not_written(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=rf"{name}: cannot write images of type"):
        write_image(tmp_path / name, UNKNOWN.original)
    assert list(tmp_path.iterdir()) == []


def test_writing_makes_folders_replaces_and_leaves_no_other_file(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "down" / "file.bin"
    for content in (b"first", b"second", b""):
        write_bytes(path, content)
        assert path.read_bytes() == content
        assert [p for p in tmp_path.rglob("*") if p.is_file()] == [path]


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("more", [b"\xff\xd8\xff\xe0 notes"])
def test_an_image_file_may_go_on_after_its_end(tmp_path: Path, suffix: str, more: bytes) -> None:
    file = tmp_path / f"long{suffix}"
    write_image(file, UNKNOWN.original)
    expected = read_image(file)
    file.write_bytes(file.read_bytes() + more)
    np.testing.assert_array_equal(read_image(file), expected)


def test_an_end_inside_a_jpegs_thumbnail_is_not_its_end(tmp_path: Path) -> None:
    file = tmp_path / "photo.jpg"
    write_image(file, UNKNOWN.original)
    data = file.read_bytes()
    thumbnail = b"\xff\xe1" + (len(data) + 2).to_bytes(2, "big") + data
    file.write_bytes(data[:2] + thumbnail + data[2:])
    assert read_image(file).shape == UNKNOWN.original.shape
    file.write_bytes(data[:2] + thumbnail + data[2:-200])
    with pytest.raises(InputError, match="damaged or cut off"):
        read_image(file)


READ_IN_LITTLE_MEMORY = """
import resource, sys
from link.errors import InputError
from link.images.files import read_image
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    read_image(sys.argv[1])
except InputError as error:
    print(error)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


@pytest.mark.slow
def test_a_small_file_of_too_many_pixels_is_refused_without_decoding_them(tmp_path: Path) -> None:
    file = tmp_path / "bomb.png"
    Image.new("L", (8000, 8000)).save(file)
    done = run_process(sys.executable, "-c", READ_IN_LITTLE_MEMORY, file)
    message, grown_kib = done.stdout.splitlines()
    assert message.startswith(f"{file}: image is 8000x8000, more than 50 megapixels")
    assert int(grown_kib) < 20_000


def test_an_image_that_holds_more_than_its_pixels_is_refused(tmp_path: Path) -> None:
    gray, file = np.full((64, 64), 90, np.uint8), tmp_path / "busy.png"
    write_image(file, gray)
    plain = file.read_bytes()
    end = plain.index(b"IDAT") - 4
    after = bytes(10**5)  # compressed, these might be 100 MB
    chunk = b"IDAT" + after
    file.write_bytes(
        plain[:end]
        + struct.pack(">I", len(after)) + chunk + struct.pack(">I", zlib.crc32(chunk))
        + plain[end:]
    )  # fmt: skip
    with pytest.raises(InputError, match="damaged or cut off"):
        read_image(file)
    progressive = cv2.imencode(".jpg", gray, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    scan = progressive[progressive.rindex(b"\xff\xda") : -2]
    file = tmp_path / "busy.jpg"
    file.write_bytes(progressive)
    assert read_image(file).shape == (64, 64, 3)
    file.write_bytes(progressive[:-2] + scan * 100 + progressive[-2:])
    with pytest.raises(InputError, match="it has more than 100 scans"):
        read_image(file)


def test_the_limit_of_pixels_can_be_moved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "picture.png"
    write_image(file, UNKNOWN.original)
    monkeypatch.setenv("OORC_MAX_MEGAPIXELS", "0.004")
    with pytest.raises(InputError, match=r"80x60, more than 0\.004 megapixels"):
        read_image(file)
    monkeypatch.setenv("OORC_MAX_MEGAPIXELS", "0.0048")
    assert read_image(file).shape == UNKNOWN.original.shape
    for wrong in ("many", "nan", "-1", "0", "inf"):
        monkeypatch.setenv("OORC_MAX_MEGAPIXELS", wrong)
        with pytest.raises(InputError, match="OORC_MAX_MEGAPIXELS: need millions of pixels"):
            read_image(file)


@cases(
    (".png", {}),
    (".jpg", {}),
    (".jpg", {"progressive": True}),
    (".bmp", {}),
    (".tif", {}),
    (".tif", {"compression": "tiff_lzw"}),
    (".tif", {"big_tiff": True}),
    (".webp", {"lossless": True}),
    (".webp", {"quality": 80}),
    (".webp", {"quality": 80, "exif": b"Exif\0\0II*\0\x08\0\0\0\0\0"}),
)
def test_the_header_tells_the_size_before_any_pixel_is_decoded(
    suffix: str, options: dict[str, Any], tmp_path: Path
) -> None:
    file = tmp_path / f"picture{suffix}"
    noise = np.random.default_rng(5).integers(0, 256, (16, 300, 3), np.uint8)
    Image.fromarray(noise).save(file, **options)
    assert read_image(file).shape == noise.shape
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OORC_MAX_MEGAPIXELS", "1e-4")
        with pytest.raises(InputError, match="300x16, more than"):
            read_image(file)
    whole = file.read_bytes()
    for length in range(0, 64, 3):
        file.write_bytes(whole[:length])
        with pytest.raises(InputError, match="not a readable image"):
            read_image(file)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_an_image_file_that_is_cut_off_is_refused(tmp_path: Path, suffix: str) -> None:
    rng = np.random.default_rng(0)
    file = tmp_path / f"cut{suffix}"
    write_image(file, rng.integers(0, 256, (64, 64, 3), dtype=np.uint8))
    assert read_image(file).shape == (64, 64, 3)
    file.write_bytes(file.read_bytes()[:-200])
    with pytest.raises(InputError, match=f"cut{suffix}: not .* damaged or cut off"):
        read_image(file)


def test_a_part_of_a_png_that_is_longer_than_the_file_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "long.png"
    write_image(file, UNKNOWN.original)
    data = bytearray(file.read_bytes())
    at = data.index(b"IDAT") - 4
    data[at : at + 4] = (2**31 - 1).to_bytes(4, "big")
    file.write_bytes(data)
    with pytest.raises(InputError, match="damaged or cut off"):
        read_image(file)
