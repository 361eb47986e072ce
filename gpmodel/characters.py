"""Characters of texts from outside: what steers a terminal, and what source of any language can hold."""

import re
import unicodedata

_STEERING = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories of characters that steer a terminal, or that none can show."""
_FOREIGN = re.compile(r"[^\w .,:;()\[\]+/°%·=±−-]")
"""Characters forbidden in generated source: quotes, backslashes, line ends, signs that begin or end a comment."""


def printable(text: str, kept: str = "\n\t") -> str:
    """Escape characters that steer a terminal, but for those that are `kept`.

    >>> printable("a\x1b[31m")
    'a\\x1b[31m'
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(c if c in kept or unicodedata.category(c) not in _STEERING else ascii(c)[1:-1] for c in text)


def steers(text: str) -> bool:
    """Return whether a text contains a character that ends a line or controls a terminal."""
    return printable(text, "") != text


def harmless(text: str) -> str:
    """Clean a text for source of any language: letters, digits, spaces and a few signs; the rest as underscores.

    >>> harmless('torque_J2 [N*m] */ system("id")')
    'torque_J2 [N·m] ·/ system(_id_)'
    """
    return _FOREIGN.sub("_", text.replace("*", "·"))


def commented(note: str) -> list[str]:
    """Write the lines of a note as comments of TOML, YAML and CSV, each of them harmless."""
    return [f"# {harmless(line)}" for line in note.splitlines()]
