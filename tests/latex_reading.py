"""Read exported LaTeX as a formula, by its notation alone."""

import re

_SHORT = (("\\left|{", "\\abs{"), ("}\\right|", "}"), ("\\left(", "("), ("\\right)", ")"), ("\\cdot", "*"),
          ("\\bmod", "%"))  # fmt: skip
_TOKEN = re.compile(
    r"(?P<number>\d+(\.\d*)?)|\\mathrm\{(?P<named>[^{}]*)\}|\\operatorname\{(?P<function>\w+)\}|\\(?P<command>[a-z]+)"
    r"|(?P<letter>[A-Za-z])(_\{(?P<index>\d+)\})?|(?P<sign>[-+*%^,(){}\[\]])"
)


def read_latex(text: str) -> str:
    """The formula with operators written out: products, powers and calls as programs have them."""
    for written, short in _SHORT:
        text = text.replace(written, short)
    reader = _Reader(list(_TOKEN.finditer(text)))
    formula = reader.sum()
    assert reader.at == len(reader.tokens), f"{text}: nothing reads {reader.tokens[reader.at][0]}"
    return formula


class _Reader:
    def __init__(self, tokens: list[re.Match[str]]) -> None:
        self.tokens, self.at = tokens, 0

    @property
    def next(self) -> str:
        return self.tokens[self.at][0] if self.at < len(self.tokens) else ""

    def take(self, wanted: str = "") -> re.Match[str]:
        token = self.tokens[self.at]
        assert wanted in ("", token[0]), f"{token[0]!r} where {wanted!r} was expected"
        self.at += 1
        return token

    def sum(self) -> str:
        """term, or - term; then + or - and a term, as often as there are any."""
        found = ""
        while True:
            sign = self.take()[0] if self.next in ("+", "-") else "+"
            found += f" {sign} ({self.product()})"
            if self.next not in ("+", "-"):
                return f"(0{found})"

    def product(self) -> str:
        """Factors side by side or with a point between; the remainder binds as a product does."""
        found = self.power()
        while self.next not in ("", "+", "-", ",", ")", "}", "]"):
            operator = self.take()[0] if self.next in ("*", "%") else "*"
            found = f"({found} {operator} {self.power()})"
        return found

    def power(self) -> str:
        base = self.atom()
        if self.next != "^":
            return base
        self.take("^")
        return f"exp({self.group()})" if base == "e" else f"power({base}, {self.group()})"

    def atom(self) -> str:
        token = self.take()
        if token["number"]:
            return token[0]
        if token["named"] is not None:
            return token["named"].replace("\\_", "_")
        if token["letter"]:
            return token["letter"] + (token["index"] or "")
        if token[0] in ("(", "{"):
            found = self.sum()
            self.take({"(": ")", "{": "}"}[token[0]])
            return found
        return self.call(token["function"] or token["command"])

    def call(self, name: str) -> str:
        if name == "frac":
            return f"({self.group()} / {self.group()})"
        if name == "sqrt" and self.next == "[":
            self.take("[")
            root = self.sum()
            self.take("]")
            return f"power({self.group()}, 1/{root})"
        exponent = ""
        if self.next == "^":
            self.take("^")
            exponent = self.group()
        found = f"{name}({self.group()})" if name not in ("min", "max") else self.fold(name)
        return f"power({found}, {exponent})" if exponent else found

    def fold(self, name: str) -> str:
        """max(a, max(b, c)) of max(a, b, c)."""
        self.take("(")
        parts = [self.sum()]
        while self.next == ",":
            self.take(",")
            parts.append(self.sum())
        self.take(")")
        found = parts[0]
        for part in parts[1:]:
            found = f"{name}({found}, {part})"
        return found

    def group(self) -> str:
        """Read the content of braces or parentheses, or a single token."""
        if self.next in ("{", "("):
            close = {"{": "}", "(": ")"}[self.take()[0]]
            found = self.sum()
            self.take(close)
            return found
        return self.atom()
