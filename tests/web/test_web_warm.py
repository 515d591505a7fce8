"""The page's receiver finds, follows and decodes the displays that are drawn to get it ready."""

import pytest

from export.web.site import WARM_PRESETS
from export.web.warm import draw_warm_film
from link.presets import PRESETS


def warm_film(kind):
    film = draw_warm_film(PRESETS[WARM_PRESETS[kind]].layout)
    return {"layout": film.layout, "states": list(film.states)}


@pytest.mark.slow
@pytest.mark.parametrize("kind", WARM_PRESETS)
def test_frame_pairs_are_decoded(port, kind) -> None:
    assert port("receive/warm.js").warmUp([warm_film(kind)]) >= 2


def test_nothing_is_read_when_there_is_no_time(port) -> None:
    assert port("receive/warm.js").warmUp([warm_film(kind) for kind in WARM_PRESETS], 0) == 0
