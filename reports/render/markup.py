"""HTML as nested calls: text is escaped wherever it is not markup already."""

from collections.abc import Sequence
from html import escape

VOID = frozenset({"br", "img", "meta"})


class Html(str):
    """Markup, fit to stand in a page as it is."""

    __slots__ = ()


def text(content: object) -> Html:
    """Escaped, unless it is `Html` already."""
    return content if isinstance(content, Html) else Html(escape(str(content)))


def join(*parts: object, by: str = "") -> Html:
    """Parts one after another, those that are not `Html` escaped."""
    return Html(by.join(text(part) for part in parts))


def tag(name: str, *content: object, **attributes: object) -> Html:
    """An element.

    Args:
        name: of the element.
        *content: elements, or text, which is escaped.
        **attributes: ``class_`` for class, ``_`` for ``-``; None leaves an attribute out.
    """
    head = name
    for key, value in attributes.items():
        if value is not None:
            head += f' {key.rstrip("_").replace("_", "-")}="{escape(str(value))}"'
    if name in VOID:
        return Html(f"<{head}>")
    return Html(f"<{head}>{join(*content)}</{name}>")


def table(
    heads: Sequence[object], rows: Sequence[Sequence[object]], caption: object = "", left: int = 1
) -> Html:
    """A table that scrolls in its own box; all but the ``left`` first columns are numbers."""

    def cells(kind: str, row: Sequence[object]) -> Html:
        return tag(
            "tr",
            *(
                tag(kind, part, class_="n" if number >= left else None)
                for number, part in enumerate(row)
            ),
        )

    parts = [tag("caption", caption)] if caption else []
    parts += [tag("thead", cells("th", heads)), tag("tbody", *(cells("td", row) for row in rows))]
    return tag("div", tag("table", *parts), class_="scroll", tabindex="0")
