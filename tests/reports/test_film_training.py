"""Windows of film are kept as they were, and train the film decoder."""

from pathlib import Path

import numpy as np

from data_gen.film.message import Take
from export.parity import synthetic_window
from link.captures import pack_windows
from link.images import write_bytes
from models.film.decoder import FilmDecoder
from reports.engine.records import to_records
from reports.film_training import (
    FilmTrainConfig,
    Recording,
    decoded,
    fit_constants,
    load_windows,
)
from reports.films import film_settings


def test_kept_windows_are_what_they_were_and_train_the_decoder(tmp_path: Path) -> None:
    settings = film_settings("robust:30")
    made, _ = synthetic_window(settings.layout, np.random.default_rng(0), frames=10, noise=8.0)
    take = Take(settings, "canon-lg", 0.0, 0, 0)
    recording = Recording(take, 1.0, tmp_path / "window.npz")
    write_bytes(recording.file, pack_windows([made] * 2))
    windows = load_windows(recording)
    assert [file.name for file in tmp_path.iterdir()] == ["window.npz"]
    assert len(windows) == 2
    observation, bits = windows[0].observation, windows[0].bits
    np.testing.assert_array_equal(bits, made.bits)
    np.testing.assert_array_equal(observation.mixture.shares, made.observation.mixture.shares)
    np.testing.assert_allclose(observation.frames, made.observation.frames, rtol=2**-10)
    module = FilmDecoder().train()
    before = [parameter.detach().clone() for parameter in module.parameters()]
    log = fit_constants(
        module,
        [(window.observation, window.bits) for window in windows],
        FilmTrainConfig(steps=2, batch=1),
    )
    assert [entry["step"] for entry in log] == [0, 1]
    assert any((new != old).any() for new, old in zip(module.parameters(), before, strict=True))
    # the pairs at both ends are seen in part; by chance half of all bits would be wrong
    records = to_records(decoded(module, windows, "film"))
    assert (records["correct"] > 0.6 * records["known"]).all()
