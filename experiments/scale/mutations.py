"""Texts made of good ones by a few edits, for readers that must refuse every bad one in one line."""

import random
from dataclasses import dataclass

TOKENS = (
    "", "0", "-1", "1e999", "nan", "inf", "null", "true", "9" * 400, "1" * 5000, "\x00", "\n", "\r\n", "\t", '"', '"""',
    "'", "\\", "/", "../", "*/", "<", "</a>", "<!--", "<!DOCTYPE x [<!ENTITY a 'b'>]>", "&a;", "&#0;", "{", "}", "[",
    "]", "(", ")", "[[", "]]", "(" * 300, "-" * 300, "[" * 3000, "J1", "J1 [deg]", ",", ";", "=", "é", "\u2028",
    "\ufeff", "\U0001f600", "__import__('os')", "lambda: 0", "**", "%", "sin(", "1/0", "log(0)", "{{7*7}}",
    "${x}", "<script>", "NaN", "Infinity", "1_0",
)  # fmt: skip
"""Tokens of the grammars, and tokens that have broken readers before."""


@dataclass(frozen=True)
class Edit:
    """One change of a text: what is done, at what share of its length, to how many characters, with which token."""

    kind: int
    place: float
    length: int
    token: int


def random_edits(rng: random.Random) -> list[Edit]:
    """From one to six edits, mostly few."""
    count = min(6, 1 + int(rng.expovariate(0.8)))
    return [Edit(rng.randrange(5), rng.random(), rng.randrange(40), rng.randrange(len(TOKENS))) for _ in range(count)]


def edited(text: str, edits: list[Edit]) -> str:
    """The text after all edits."""
    for edit in edits:
        at = int(edit.place * (len(text) + 1))
        end = at + edit.length
        match edit.kind:
            case 0:
                text = text[:at] + TOKENS[edit.token] + text[at:]
            case 1:
                text = text[:at] + text[end:]
            case 2:
                text = text[:at] + TOKENS[edit.token] + text[end:]
            case 3:
                text = text[:at] + 3 * text[at:end] + text[end:]
            case _:
                text = (
                    text[:at] + "".join(chr(ord(c) ^ 1 << edit.length % 7) for c in text[at : at + 1]) + text[at + 1 :]
                )
    return text
