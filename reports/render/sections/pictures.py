"""Strips of pictures, and the gallery of failures."""

import base64

from reports.evaluation.stories import Story
from reports.render.markup import Html, join, table, tag
from reports.render.sections.common import absent
from reports.run import Run


def pictures(run: Run) -> Html:
    """Strips of typical frame pairs."""
    stories = [story for story in run.stories if story.kind == "strip"]
    if not stories:
        return absent("Pictures", "No frame pair was decoded by the methods that are shown.")
    note = tag(
        "p",
        "For each view and κ, the frame pair with the median number of wrong bits. In the last "
        "pictures light blocks are decided 1, dark blocks 0; a block’s frame is green where the "
        "bit is right, red and thick where it is wrong, blue where the truth is unknown."
        if not run.from_folder
        else "Light blocks are decided 1, dark blocks 0; frames are green where the bit is right, "
        "red and thick where it is wrong, blue where the truth is unknown.",
        class_="note",
    )
    return join(note, *(_story(run, story) for story in stories))


def failures(run: Run) -> Html:
    """The worst frame pairs of the leading method, with the reason measured."""
    stories = [story for story in run.stories if story.kind == "failure"]
    if not stories:
        return absent("Failures", "No wrong bit of the leading method is known.")
    note = tag(
        "p",
        "Most wrong bits: at most two of the main comparison and one of each sweep. The reason is "
        "measured: the draw is filmed again without noise, which tells signal, drift, motion and "
        "noise of each block apart."
        if not run.from_folder
        else "Most wrong bits first, with what the capture tells of the blocks that were misread.",
        class_="note",
    )
    return join(note, *(_story(run, story) for story in stories))


def _story(run: Run, story: Story) -> Html:
    figures = []
    for file, caption in story.pictures:
        data = base64.b64encode((run.folder / file).read_bytes()).decode()
        image = tag("img", src=f"data:image/jpeg;base64,{data}", alt=caption)
        figures.append(tag("figure", image, tag("figcaption", caption)))
    parts = [
        tag("h3", story.title),
        tag("p", story.where, class_="note"),
    ]
    if story.reason:
        parts.append(tag("p", story.reason))
    parts.append(tag("div", *figures, class_="strip"))
    if story.measured:
        rows = [[name, f"{a:.2f}", f"{b:.2f}"] for name, (a, b) in story.measured.items()]
        heads: list[object] = ["mean over blocks, gray levels", "wrong blocks", "other blocks"]
        parts.append(tag("details", tag("summary", "measured"), table(heads, list(rows))))
    return tag("div", *parts, class_="story")
