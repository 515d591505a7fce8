"""The door for own recordings: a film, several of them, or photographs in the order of the states.

Each is found, followed and timed as the receiver does it, cut into observations, and compared with
what was sent. What does not fit is refused, and so nothing is scored by a wrong truth. What comes
out is a folder of captures (`link.captures`), and films.json, which says what the receiver saw.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from link.captures import MANIFEST, KnownWindow, save_captures
from link.errors import InputError
from link.frames import Captured
from link.images import image_files
from link.images.files import read_image
from link.layout import Layout
from link.observation import Observation
from link.outside import is_file, read_json
from models.film.window import reads_films
from receiver.sources import open_source
from receiver.tracking.two_images import STILL, find_in_both, state_change
from reports.captured.receive import Cut, Reception, open_readers, receive_film
from reports.captured.sent import Sent, read_sent, sent_of
from reports.captured.truth import Match, match_loop
from reports.engine.checked import checked, write_json
from reports.engine.digest import file_digest, short_digest

FILMS = "films.json"
"""Name of the file that says what the receiver saw of each film."""
VIDEOS = (".mp4", ".mov", ".mkv", ".avi", ".webm", ".m4v", ".3gp", ".y4m")
"""Endings of the names of films in a folder of several."""
CLEARER = 1.25
"""Square roots of the number of bits by which another frame pair of the loop must fit photographs
better than the expected one before they are taken to show that one."""
Known = KnownWindow | Captured


class UnreadError(InputError):
    """No display is found in a film, or none of its parts is read well enough to be matched."""


@dataclass(frozen=True)
class Recordings:
    """Recordings and what they show; nothing is decoded yet."""

    films: tuple[tuple[Path, tuple[Sent, ...]], ...]
    """Films and what each shows, a loop or those of a bench; one folder where it holds photographs.
    """
    photos: bool
    """Whether the folder holds photographs of the states, one of each in order."""
    meta: dict[str, Any]
    """Keys that all captures get, such as pair and view_deg."""
    fps: float | None = None
    """Frames a second of the films, in place of what they state."""

    @property
    def digest(self) -> str:
        """Digest of all files: another film in the same place is another run."""
        parts = [sent[0].digest for _, sent in self.films]
        for film, _ in self.films:
            parts.append(file_digest(image_files(film) if film.is_dir() else [film]))
        return short_digest(*parts)

    @property
    def layouts(self) -> list[Layout]:
        """Layouts that are shown, each once."""
        return list(dict.fromkeys(each.layout for _, sent in self.films for each in sent))

    @property
    def are_windows(self) -> bool:
        """Whether windows of film are decoded, of some layout at least."""
        return not self.photos and any(map(reads_films, self.layouts))

    def record(self, folder: Path) -> list[str]:
        """Write the captures to a folder, unless it holds them already.

        Of several films, those that cannot be read are left out.

        Returns:
            a line for each film and each part that was left out.

        Raises:
            InputError: a recording does not show what was sent, or none can be read; one line says
                where.
        """
        if is_file(folder / MANIFEST):
            content = read_json(folder / FILMS)
            notes = content.get("notes") if isinstance(content, dict) else None
            return checked(list[str], notes, str(folder / FILMS))
        captures: list[Known] = []
        seen: list[dict[str, Any]] = []
        notes = []
        for film, shown in self.films:
            angle = re.search(r"(?<!\d)([0-8]?\d)deg", film.stem)
            meta = {"film": film.name} | ({"view_deg": float(angle[1])} if angle else {})
            meta = {"pair": film.stem} | meta | self.meta
            try:
                received = list(self.received(film, shown, notes))
            except UnreadError as error:
                if len(self.films) == 1:
                    raise
                notes.append(f"left out: {error}")
                continue
            for sent, found, view in received:
                name = f"{film.name}: {sent.part}" if sent.part else film.name
                own = {"film": name, "pair": sent.part} if sent.part else {}
                captures += [
                    replace(each, kappa=sent.kappa, meta={**meta, **own, **each.meta})
                    for each in found
                ]
                seen.append({"film": name, **view})
        if not captures:
            raise InputError("nothing of what --sent shows could be read; " + "; ".join(notes))
        content = {"films": seen, "notes": notes}
        write_json(folder / FILMS, content)
        save_captures(folder, captures)
        return notes

    def received(
        self, film: Path, shown: tuple[Sent, ...], notes: list[str]
    ) -> Iterator[tuple[Sent, list[Known], dict[str, Any]]]:
        """Give each loop that a film shows, its observations, and what the receiver saw of it.

        Args:
            film: a film, or a folder of photographs.
            shown: the loop, or those of a bench.
            notes: gets a line on what was left out.
        """
        if self.photos:
            yield shown[0], photographed(film, shown[0]), {}
        elif not shown[0].part:
            reception = watch(film, shown[0].layout, self.fps)
            if not reception.cuts:
                raise UnreadError(f"{film}: {reception.seen['silence']}")
            found, left_out = truths(film, reception, shown[0])
            notes += left_out
            yield shown[0], found, reception.seen
        else:
            for layout in dict.fromkeys(sent.layout for sent in shown):
                reception = watch(film, layout, self.fps)
                for sent in (each for each in shown if each.layout == layout):
                    found, seconds = bench_part(reception, sent)
                    notes.append(f"{film.name}: {sent.part}: {seconds:.1f} s of it are read")
                    if found:
                        yield sent, found, {**reception.seen, "state_hz": sent.state_hz}


def bench_part(reception: Reception, sent: Sent) -> tuple[list[Known], float]:
    """Give the observations of a film of a bench that show one of its parts, and their seconds."""
    found: list[Known] = []
    seconds = 0.0
    for cut in reception.cuts:
        match = match_loop(cut.scores, sent.bits)
        if match.kind == "fits":
            found += cut.known(match.bits, ends=False)
            seconds += cut.end_s - cut.begin_s
    return found, seconds


def open_recordings(
    place: Path, sent: Path, photos: bool, meta: dict[str, Any], fps: float | None = None
) -> Recordings:
    """Find the films of a place and what each of them shows.

    Args:
        place: a film (a video or a folder of its frames), a folder of several, or one of
            photographs.
        sent: a player's .html, a folder of states or its sent.json; beside several films also a
            folder with one of these for each, named as the film.
        photos: whether it holds photographs of the states, one of each in order.
        meta: keys that all captures get; what is None is left out.
        fps: frames a second of the films, in place of what they state.

    Raises:
        InputError: nothing is there, or what was sent is no good.
    """
    if not place.exists():
        raise InputError(f"--captures: {place}: no such film or folder")
    films = [place]
    if place.is_dir() and not photos:
        inner = [each for each in sorted(place.iterdir()) if not each.name.startswith(".")]
        videos = [each for each in inner if each.suffix.lower() in VIDEOS]
        folders = [each for each in inner if each.is_dir() and any(each.glob("*.png"))]
        films = videos + folders or films
    read: dict[Path, tuple[Sent, ...]] = {}
    for film in films:
        own = sent_of(sent, film)
        if own not in read:
            read[own] = read_sent(own)
    given = {key: value for key, value in meta.items() if value is not None}
    return Recordings(tuple((f, read[sent_of(sent, f)]) for f in films), photos, given, fps)


def watch(film: Path, layout: Layout, fps: float | None) -> Reception:
    """Receive a film to its end.

    Raises:
        InputError: it cannot be read.
    """
    source = open_source(str(film), fps)
    frames = tqdm(source.frames, desc=film.name, unit="frame")
    seen = ((frame.image, frame.time) for frame in frames)
    return receive_film(seen, source.fps, layout, apart=True)


def truths(film: Path, reception: Reception, sent: Sent) -> tuple[list[Known], list[str]]:
    """Give the observations of a film with what was sent in each.

    Returns:
        observations, and a line if some were left out.

    Raises:
        InputError: the film does not show what was sent; the line names the second.
    """
    matches = [match_loop(cut.scores, sent.bits) for cut in reception.cuts]
    check_film(film, reception.cuts, matches)
    found: list[Known] = []
    for cut, match in zip(reception.cuts, matches, strict=True):
        if match.kind == "fits":
            found += cut.known(match.bits, ends=False)
    left = [c.begin_s for c, m in zip(reception.cuts, matches, strict=True) if m.kind != "fits"]
    if not left:
        return found, []
    seconds = ", ".join(f"{second:.1f}" for second in left[:5])
    return found, [
        f"{film.name}: {len(left)} of {len(matches)} parts are left out, at {seconds} s"
        f"{' and later' if len(left) > 5 else ''}: what they show of the loop is not clear there"
    ]


def check_film(film: Path, cuts: list[Cut], matches: list[Match]) -> None:
    """Raise an `InputError` where a film shows something else than what was sent.

    One part that fits nowhere may hold a cut of the film. Two in a row, or one at its beginning or
    end, show something else.
    """
    kinds = [match.kind for match in matches]
    strange = [kind == "other" for kind in kinds]
    for at, other in enumerate(strange):
        alone = 0 < at < len(kinds) - 1 and not strange[at - 1] and not strange[at + 1]
        if other and not alone:
            raise InputError(
                f"{film}: from {cuts[at].begin_s:.1f} s on it is read well and does not show what "
                "--sent holds; give what was shown then, or cut the film there"
            )
    if "fits" not in kinds:
        if "jumps" in kinds or "other" in kinds:
            second = cuts[next(i for i, k in enumerate(kinds) if k != "unclear")].begin_s
            raise InputError(
                f"{film}: from {second:.1f} s on it does not go on as the loop of --sent does; is "
                "it cut there, or was the player paused?"
            )
        raise UnreadError(
            f"{film}: no part is read well enough to tell which part of --sent it shows; film "
            "longer, closer or steadier, or give what was shown"
        )


def photographed(folder: Path, sent: Sent) -> list[Known]:
    """Give the frame pairs of photographs that show the states one after another.

    Raises:
        InputError: their number does not fit, a display is not found, or they do not show the
            states in order; the line names the first photograph that does not fit.
    """
    photos, pairs = image_files(folder), len(sent.bits)
    if not photos or len(photos) % (2 * pairs):
        raise InputError(
            f"{folder}: {len(photos)} photographs of {2 * pairs} states; give one of each state, "
            "or the same number of each round"
        )
    decoder, _ = open_readers(sent.layout)
    found: list[Known] = []
    matches: list[Match] = []
    for number in tqdm(range(len(photos) // 2), unit="pair", desc=folder.name):
        sign = sent.layout.code.sign(number % pairs)
        files = photos[2 * number : 2 * number + 2][::sign]
        images = [read_image(file) for file in files]
        if images[0].shape != images[1].shape:
            raise InputError(f"{files[1]}: is of another size than {files[0].name}")
        display = find_in_both(images[0], images[1], [sent.layout])
        if display is None:
            raise InputError(
                f"{files[0]}, {files[1].name}: no display is found that changes as the two states "
                f"no. {2 * number % (2 * pairs) + 1} and the next do; is one doubled or missing, "
                "or did the camera move?"
            )
        bits = sent.bits[number % pairs]
        captured = Captured(images[0], images[1], sent.layout, *display.corners, bits)
        seen: Observation = captured.rectified()
        change = state_change(seen.original, seen.embedded, sent.layout)
        scores = decoder.decode(seen.original, seen.embedded).scores[None]
        expected = match_loop(scores, sent.bits, number)
        free = match_loop(scores, sent.bits)
        elsewhere = free.kind == "fits" and not np.array_equal(free.bits, expected.bits)
        gain = (np.sign(scores) * (2 * (free.bits - expected.bits))).sum() / 2
        clearer = elsewhere and gain > CLEARER * np.sqrt(sent.layout.n_bits)
        if change <= STILL or expected.kind == "other" or clearer:
            raise InputError(
                f"{folder}: photographs from no. {2 * number + 1} ({min(files).name}) on do not "
                "show the states of --sent in order; is one doubled, missing or out of order?"
            )
        matches.append(expected)
        found.append(replace(captured, meta={"picture": f"pair {number % pairs}"}))
    unclear = [at for at, match in enumerate(matches) if match.kind != "fits"]
    if 2 * len(unclear) > len(matches):
        raise InputError(
            f"{folder}: {len(unclear)} of {len(matches)} frame pairs are read too badly to tell "
            "whether they show the states of --sent"
        )
    return found
