"""Films as phones make them are read: shaking hands, a video codec at an angle, bent lines."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import cases

from data_gen.film.codec import CodecSettings, through_codec
from data_gen.film.message import FilmSettings, Take, film_message
from data_gen.film.phone import PhoneSettings
from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from export.runtime import Decoder
from lab.films.rates import graph_of, read_message
from link.code.framing import encode
from link.embed import embed
from link.layout import make_layout
from models import PRETRAINED
from receiver.receiver import Receiver

TEXT = b"phones"


@pytest.mark.slow
@cases((6.0, CodecSettings()), (1.0, CodecSettings("h264", kbits=8000)), ids=["hand 6", "h264"])
def test_a_film_at_an_angle_is_read(hand: float, codec: CodecSettings) -> None:
    layout = make_layout()
    source = Source(layout, "test", 0)
    pictures = shuffled_pictures(source)
    pairs = [embed(pictures[0].rgb, bits, layout, 3) for bits in encode(TEXT, layout.n_bits)]
    states = [state for pair in pairs for state in (pair.original, pair.embedded)]
    settings = VideoSettings(
        scene=SceneSettings(coverage=0.35, pictures=pictures, free=0.03), seconds=3.0, hand=hand
    )
    rng = np.random.default_rng(4)
    frames = film(states, layout, source.pair("canon-lg"), 45.0, settings, rng)
    receiver = Receiver(Decoder(PRETRAINED / "decoder.onnx"), settings.fps)
    locked, received = [], None
    for frame in through_codec(frames, codec, settings.fps):
        step = receiver.push(frame.rgb, frame.time_s)
        locked.append(receiver.synchronised)
        if step.message is not None:
            received = step.message.data
            break
    assert received == TEXT
    first = locked.index(True)
    assert first <= 40
    assert all(locked[first:])
    assert receiver.found >= len(locked) - 6


@pytest.mark.slow
def test_a_lens_that_bends_the_display_costs_few_bits() -> None:
    """Blocks of the preset fast are small. The same draws are filmed through both lenses."""
    plain = FilmSettings(preset="fast", state_hz=30, fps=60, n_bytes=5000)
    wrong = []
    for k in (0.0, -0.1):
        settings = replace(plain, phone=PhoneSettings(distortion=k))
        take = Take(settings, "canon-lg", 0.0, 0, 0)
        delivery = read_message(film_message(take), Decoder(graph_of(take)))
        assert delivery.delivered
        wrong.append(delivery.bits_wrong / delivery.bits)
    assert wrong[1] < wrong[0] + 0.01
