"""Pages from the templates of this folder, in which every text is escaped."""

from collections.abc import Mapping
from pathlib import Path

import jinja2

TEMPLATES = Path(__file__).parent / "templates"
"""Folder of the Jinja2 templates and of the style sheet."""
ENVIRONMENT = jinja2.Environment(
    loader=jinja2.FileSystemLoader(TEMPLATES),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
"""Compiles the templates; every text is escaped, and a name that is not given is an error."""


def render(template: str, colours: Mapping[str, str], **content: object) -> str:
    """Fill a template.

    Args:
        template: name of a file of `TEMPLATES`.
        colours: by text, the colour of a dot that stands before it in tables.
        **content: what the template shows; texts are escaped, `markupsafe.Markup` is not.

    >>> "&lt;b&gt;" in ENVIRONMENT.from_string("{{ text }}").render(text="<b>")
    True
    """
    return ENVIRONMENT.get_template(template).render(content, colours=colours)
