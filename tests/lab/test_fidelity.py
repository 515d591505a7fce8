"""How much a message changes the picture: hardly with antipodal blocks, plainly with patches."""

from conftest import cases, slow

from data_gen.pictures.library import load_pictures
from lab.visibility.fidelity import PICTURES, Shown, changed_colours
from link.embed import BLACK


def test_all_pictures_are_there_and_none_counts_twice() -> None:
    for split, names in PICTURES.items():
        assert set(names) <= {each.name for each in load_pictures(split, 64, 48)}
    assert len({name for names in PICTURES.values() for name in names}) == 10


@cases(("hidden", BLACK), slow("robust", 3 * BLACK), slow("paper", None))
def test_patches_change_the_picture_and_pilots_do_not(preset: str, most: int | None) -> None:
    found = changed_colours(Shown(preset, "slide/4", "test"))
    assert 0 <= found["mean"] <= found["high"]
    if most is None:
        assert found["mean"] > 2
    else:
        assert found["levels"] <= most
    if preset == "hidden":
        assert found["high"] <= 1  # which is just noticeable
