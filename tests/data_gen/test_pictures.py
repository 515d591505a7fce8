import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from data_gen.pictures.library import Picture, load_folder, load_pictures
from link.errors import InputError
from link.types import Image

SIZE = (320, 240)
SPLITS = ("train", "test")


@pytest.fixture(scope="module")
def splits() -> dict[str, list[Picture]]:
    return {split: load_pictures(split, *SIZE) for split in SPLITS}


def source(picture: Picture) -> str:
    """The photograph or the drawing behind a picture, without the number of the crop."""
    name = picture.name
    return name.rpartition("/")[0] if name.startswith("photo/") else name


def is_photo(picture: Picture) -> bool:
    return picture.name.startswith("photo/")


def save(path: Path, rgb: Image) -> None:
    assert cv2.imwrite(str(path), cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))


def test_sizes_of_the_splits(splits: dict[str, list[Picture]]) -> None:
    assert len(splits["train"]) == 20
    assert len(splits["test"]) == 15
    assert sum(map(is_photo, splits["test"])) == 9
    assert len({source(p) for p in splits["test"] if is_photo(p)}) == 9


def test_nothing_is_shared_between_the_splits(splits: dict[str, list[Picture]]) -> None:
    train, test = splits["train"], splits["test"]
    assert {source(p) for p in train}.isdisjoint(source(p) for p in test)
    names = [p.name for p in train + test]
    assert len(set(names)) == len(names)
    contents = {p.rgb.tobytes() for p in train + test}
    assert len(contents) == len(names)


def test_no_two_pictures_look_alike(splits: dict[str, list[Picture]]) -> None:
    pictures = splits["train"] + splits["test"]
    small = [cv2.resize(p.rgb, (16, 12), interpolation=cv2.INTER_AREA) for p in pictures]
    flat = np.stack(small).reshape(len(small), -1).astype(float)
    distance = np.abs(flat[:, None] - flat[None]).mean(axis=2)
    np.fill_diagonal(distance, np.inf)
    i, j = np.unravel_index(np.argmin(distance), distance.shape)
    assert distance[i, j] > 6.0, f"{pictures[i].name} looks like {pictures[j].name}"


def test_the_same_bytes_on_every_call(splits: dict[str, list[Picture]]) -> None:
    np.random.seed(7)  # noqa: NPY002 - the global state must make no difference
    for split in SPLITS:
        again = load_pictures(split, *SIZE)
        assert [p.name for p in again] == [p.name for p in splits[split]]
        for first, second in zip(splits[split], again, strict=True):
            np.testing.assert_array_equal(first.rgb, second.rgb, err_msg=first.name)


@pytest.mark.parametrize("size", [(400, 225), (150, 270), (16, 16)])
def test_exact_shape_at_any_aspect(size: tuple[int, int]) -> None:
    for split in SPLITS:
        for picture in load_pictures(split, *size):
            assert picture.rgb.shape == (size[1], size[0], 3), picture.name
            assert picture.rgb.dtype == np.uint8
            assert picture.rgb.flags.c_contiguous


@pytest.mark.parametrize("split", SPLITS)
def test_every_drawing_has_flat_areas_and_type(
    splits: dict[str, list[Picture]], split: str
) -> None:
    for picture in filter(lambda p: not is_photo(p), splits[split]):
        gray = cv2.cvtColor(picture.rgb, cv2.COLOR_RGB2GRAY)
        blocks = gray.reshape(30, 8, 40, 8).swapaxes(1, 2).reshape(-1, 64)
        flat = np.mean(np.ptp(blocks, axis=1) == 0)
        steps = np.abs(np.diff(gray.astype(int), axis=1)) > 50
        assert flat > 0.08, picture.name
        assert 0.005 < np.mean(steps) < 0.3, picture.name


@pytest.mark.parametrize("split", SPLITS)
def test_drawings_hold_pure_white_and_pure_black(
    splits: dict[str, list[Picture]], split: str
) -> None:
    drawn = [p.rgb for p in splits[split] if not is_photo(p)]
    for level in (0, 255):
        share = [np.mean(np.all(rgb == level, axis=2)) for rgb in drawn]
        assert sum(s > 0.3 for s in share) >= 1


def test_photographs_are_not_stretched() -> None:
    """The colour wheel stays round: its black corners are equally far in x and y."""
    wheel = next(p for p in load_pictures("train", 300, 300) if p.name == "photo/color/0")
    inside = wheel.rgb.max(axis=2) > 40
    rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
    assert abs(np.ptp(rows) - np.ptp(columns)) <= 3


def test_folder_sorts_crops_and_passes_over_other_files(tmp_path: Path) -> None:
    stripes = np.zeros((100, 300, 3), np.uint8)
    stripes[:, :100], stripes[:, 100:200], stripes[:, 200:] = (255, 0, 0), (0, 200, 0), (0, 0, 90)
    save(tmp_path / "b.PNG", stripes)
    save(tmp_path / "a.bmp", np.full((64, 64, 3), 77, np.uint8))
    (tmp_path / "notes.txt").write_text("not a picture")
    (tmp_path / "._a.jpg").write_bytes(b"left behind by a file manager")
    (tmp_path / "more.png").mkdir()

    pictures = load_folder(tmp_path, 80, 80)

    assert [p.name for p in pictures] == ["a.bmp", "b.PNG"]
    assert np.all(pictures[0].rgb == 77)
    assert pictures[1].rgb.shape == (80, 80, 3)
    assert np.all(pictures[1].rgb == (0, 200, 0))  # the middle third, in RGB order


def test_folder_errors_name_the_culprit(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        load_folder(tmp_path / "nowhere", *SIZE)
    with pytest.raises(InputError, match=re.escape(".png, .jpg")):
        load_folder(tmp_path, *SIZE)

    save(tmp_path / "tiny.png", np.zeros((63, 200, 3), np.uint8))
    with pytest.raises(InputError, match=r"tiny\.png.*200x63.*64x64"):
        load_folder(tmp_path, *SIZE)
    with pytest.raises(InputError, match=r"tiny\.png"):
        load_folder(tmp_path / "tiny.png", *SIZE)

    (tmp_path / "broken.jpg").write_bytes(b"no image at all")
    with pytest.raises(InputError, match=r"broken\.jpg"):
        load_folder(tmp_path, *SIZE)
