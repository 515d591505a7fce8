"""One measurement: what somebody who knows the corners sees of the films that gave no message.

Films of `python -m lab rates --settings hidden --n-bytes 100 --seed 5 --runs 12`, three seconds.
"""

from dataclasses import replace

import lab.films.pilot_search as study
from lab.films.rates import SETTINGS
from lab.films.trial import Take, film_message
from link.presets import PRESETS
from reports.engine.backends import one_thread

MISSED = (
    ("sony-samsung", 0.0, 0),
    ("canon-samsung", 0.0, 4),
    ("canon-samsung", 45.0, 9),
    ("canon-samsung", 45.0, 10),
)
"""Pair, view in degrees and run of the films."""
SECONDS = 3.0
"""Length of each film that is looked at."""


def main() -> None:
    """Print when the display is surely seen, and the largest evidence before."""
    one_thread()
    find, settings = study.find_toggling, replace(SETTINGS["hidden"], n_bytes=100)
    seen: list[float] = []

    def noted(*given: object) -> tuple[float, float]:
        found = find(*given)
        seen.append(found[0])
        return found

    study.find_toggling = noted
    for pair, view, run in MISSED:
        filmed = film_message(Take(settings, pair, view, run, 5))
        observer = study.KnownCorners(PRESETS["hidden"].layout, settings.fps)
        seen.clear()
        for frame in filmed.frames:
            observer.push(frame)
            if observer.sure_s is not None or frame.time_s > SECONDS:
                break
        print(pair, view, run, filmed.picture, observer.sure_s, max(seen))


main()
