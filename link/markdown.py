"""Tables in GitHub's Markdown, for terminals and documents."""

from collections.abc import Sequence


def markdown_table(heads: Sequence[str], rows: Sequence[Sequence[str]], left: int = 1) -> str:
    """Write a table.

    Args:
        heads: texts above the columns.
        rows: texts of each row, as many as there are heads.
        left: number of leading columns that are text, aligned left; the others are numbers.

    >>> print(markdown_table(["method", "right %"], [["oorc", "99.2"]]))
    | method | right % |
    |---|---:|
    | oorc | 99.2 |
    """
    marks = ["---"] * left + ["---:"] * (len(heads) - left)
    lines = [f"| {' | '.join(texts)} |" for texts in (heads, *rows)]
    return "\n".join([lines[0], f"|{'|'.join(marks)}|", *lines[1:]])
