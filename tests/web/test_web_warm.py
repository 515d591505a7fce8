"""The page's receiver finds, follows and decodes the display that is drawn to get it ready."""

import pytest

from link.presets import PRESETS
from web.host.site import WARM_PRESET
from web.host.warm import draw_warm_film


def warm_film():
    film = draw_warm_film(PRESETS[WARM_PRESET].layout)
    return {"layout": film.layout, "states": list(film.states)}


@pytest.mark.slow
def test_frame_pairs_are_decoded(port) -> None:
    assert port("receiver/warm.js").warmUp(warm_film()) >= 2


def test_nothing_is_read_when_there_is_no_time(port) -> None:
    assert port("receiver/warm.js").warmUp(warm_film(), 0) == 0
