"""Replace characters of untrusted text that control a terminal or would break generated source code."""

import codecs
import re
import shlex
import subprocess
import sys
import unicodedata
from keyword import iskeyword
from pathlib import Path

_STEERING = ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp")
"""Unicode categories of characters that control a terminal or have no visible form."""
UNBROKEN = r'^[^"\\\x00-\x1f\x7f\x85\u2028\u2029\ud800-\udfff]*\Z'
"""Pattern of text that cannot end a line, a comment or a string of source code generated from a model."""
_FOREIGN = re.compile(r"[^\w .,:;()\[\]+/°%·=±−-]")
"""Characters forbidden in generated source: quotes, backslashes, line ends, signs that begin or end a comment."""
PLAIN = "gpmodel.plain"
"""Name of an error handler that replaces a character that an encoding lacks by its ASCII form."""
_PLAIN = str.maketrans(
    {
        "−": "-", "–": "-", "—": "-", "─": "-", "→": "->", "←": "<-", "≤": "<=", "≥": ">=", "≈": "~",
        "½": "1/2", "µ": "u", "μ": "u", "ß": "ss",
        "×": "x", "·": "*", "±": "+/-", "√": "sqrt", "∞": "inf", "°": "deg", "●": "*", "○": "o",
    }
)  # fmt: skip
_RAISED = re.compile("[⁻⁺⁰¹²³⁴-⁹]+")


def printable(text: str, kept: str = "\n\t") -> str:
    """Escape characters that control a terminal, except the characters in `kept`.

    >>> printable("a\x1b[31m")
    'a\\x1b[31m'
    """
    if text.isascii() and text.isprintable():
        return text
    return "".join(c if c in kept or unicodedata.category(c) not in _STEERING else ascii(c)[1:-1] for c in text)


def is_name(text: str) -> bool:
    """Return whether a text can be a name in an expression: an identifier of Python that is no keyword."""
    return text.isidentifier() and not iskeyword(text)


def steers(text: str) -> bool:
    """Return whether a text contains a character that ends a line or controls a terminal."""
    return printable(text, "") != text


def harmless(text: str) -> str:
    """Clean a text for source of any language: letters, digits, spaces and a few signs; the rest as underscores.

    >>> harmless('torque_J2 [N*m] */ system("id")')
    'torque_J2 [N·m] ·/ system(_id_)'
    """
    return _FOREIGN.sub("_", text.replace("*", "·"))


def plain(text: str) -> str:
    """Write a text in ASCII letters that keep its meaning.

    >>> plain("−0.3 ± 0.1 ×10⁻⁶ σ, Lücke")
    '-0.3 +/- 0.1 x10^-6 sigma, Lucke'
    """
    text = _RAISED.sub(lambda found: f"^{unicodedata.normalize('NFKC', found[0])}", text)
    return "".join(c if c.isascii() else _plain(c) for c in text)


def _plain(character: str) -> str:
    name = unicodedata.name(character, "")
    likened = unicodedata.normalize("NFKD", character.translate(_PLAIN)).translate(_PLAIN)
    if not likened.isascii() and name.startswith("GREEK "):
        word = name.split(" LETTER ")[-1].split()[0]
        return word.capitalize() if "CAPITAL" in name else word.lower()
    return likened.encode("ascii", "ignore").decode() or "?"


def _unencodable(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return plain(error.object[error.start : error.end]), error.end


codecs.register_error(PLAIN, _unencodable)


def shell_quoted(word: Path | str) -> str:
    """Quote a word for the command line of this operating system, if the word needs quotes."""
    return subprocess.list2cmdline([str(word)]) if sys.platform == "win32" else shlex.quote(str(word))


def commented(note: str) -> list[str]:
    """Write each line of a note as a comment of TOML, YAML or CSV, without characters that could end the comment."""
    return [f"# {harmless(line)}" for line in note.splitlines()]
