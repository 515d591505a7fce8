"""Films as phones make them are read: shaking hands, a video codec at an angle, bent lines."""

import numpy as np
import pytest

from data_gen.film.codec import CodecSettings, through_codec
from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from export.runtime import Decoder
from link.code.framing import encode
from link.embed import embed
from link.layout import make_layout
from models import PRETRAINED
from receiver.receiver import Receiver

TEXT = b"phones"


@pytest.mark.slow
def test_a_film_at_an_angle_is_read() -> None:
    layout = make_layout()
    source = Source(layout, "test", 0)
    pictures = shuffled_pictures(source)
    pairs = [embed(pictures[0].rgb, bits, layout, 3) for bits in encode(TEXT, layout.n_bits)]
    states = [state for pair in pairs for state in (pair.original, pair.embedded)]
    settings = VideoSettings(
        scene=SceneSettings(coverage=0.35, pictures=pictures, free=0.03), seconds=3.0, hand=6.0
    )
    rng = np.random.default_rng(4)
    frames = film(states, layout, source.pair("canon-lg"), 45.0, settings, rng)
    receiver = Receiver(Decoder(PRETRAINED / "decoder.onnx"), settings.fps)
    locked, received = [], None
    for frame in through_codec(frames, CodecSettings("h264", kbits=8000), settings.fps):
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
