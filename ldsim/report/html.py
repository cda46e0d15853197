"""HTML that is balanced and escaped because of how it is built: elements from children, text always escaped."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from html import escape
from typing import final

VOID = ("img", "meta", "br", "input")
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


@final
class Markup(str):
    """Text that is HTML already; every other string is escaped on its way into an element."""

    __slots__ = ()


def element(name: str, /, *children: str, **attributes: str | None) -> Markup:
    """An element with its children, in which only `Markup` is taken as it is.

    Attributes that are Python words end in an underscore (`class_`), hyphens are underscores; None leaves one out.
    """
    pairs = ((key.rstrip("_").replace("_", "-"), value) for key, value in attributes.items() if value is not None)
    opening = name + "".join(f' {key}="{escape(value)}"' for key, value in pairs)
    if name in VOID:
        return Markup(f"<{opening}>")
    return Markup(f"<{opening}>{joined(*children)}</{name}>")


def joined(*children: str) -> Markup:
    """The children one after another, escaped where they are not markup."""
    return Markup("".join(child if type(child) is Markup else escape(child) for child in children))


def number(value: float | None, digits: int = 3, factor: float = 1.0, unit: str = "") -> Markup:
    """A number rounded for reading that carries its exact value for programs, or a dash where it was not measured.

    Args:
        value: as the report holds it.
        digits: significant digits shown; whole numbers are shown in full, with thin spaces between thousands.
        factor: from the report's unit to the one shown, such as 100 for per cent.
        unit: written after the number.
    """
    if value is None:
        return element("span", "–", class_="null", title="not measured")
    text = readable(value if factor == 1 else value * factor, digits) + (f"\u202f{unit}" if unit else "")
    exact = json.dumps(value)
    return element("data", text, value=exact, title=None if exact == text else exact)


def readable(value: float, digits: int = 3) -> str:
    """Whole numbers in full, others in so many significant digits, without exponent where that stays short."""
    if value == 0 or isinstance(value, int):
        return _spaced(value)
    if not 1e-4 <= abs(value) < 1e7:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        return f"{mantissa} · 10{str(int(exponent)).translate(SUPERSCRIPTS)}"
    rounded = f"{value:#.{digits}g}".rstrip(".")
    return _spaced(value) if "e" in rounded else rounded


def _spaced(value: float) -> str:
    """A number without decimals, its thousands apart by narrow no-break spaces."""
    return f"{value:,.0f}".replace(",", "\u202f")


def percent(value: float | None, digits: int = 3) -> Markup:
    """A fraction as per cent."""
    return number(value, digits, factor=100, unit="%")


def text(value: str | None) -> Markup:
    """A string, or a dash where there is none."""
    return element("span", "–", class_="null", title="not measured") if value is None else joined(value)


def table(header: Sequence[str], rows: Sequence[Sequence[str]], caption: str, highlight: int | None = None) -> Markup:
    """A table that scrolls sideways on a narrow page; the first cell of each row is its heading.

    Args:
        header, rows: texts or markup.
        caption: what the table shows, one sentence.
        highlight: index of a row to set apart.
    """
    head = element("tr", *(element("th", cell, scope="col") for cell in header))
    body = [
        element(
            "tr",
            element("th", row[0], scope="row"),
            *(element("td", cell) for cell in row[1:]),
            class_="own" if i == highlight else None,
        )
        for i, row in enumerate(rows)
    ]
    content = (element("caption", caption), element("thead", head), element("tbody", *body))
    return element("div", element("table", *content), class_="scroll", tabindex="0")


def picture(name: str, data: bytes) -> Markup:
    """An image inside the page, with its name as caption.

    Raises:
        ValueError: if the bytes are neither PNG nor WebP.
    """
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        kind = "png"
    elif data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        kind = "webp"
    else:
        raise ValueError(f"picture {name!r} begins with {data[:12]!r}; expected PNG or WebP")
    source = f"data:image/{kind};base64,{b64encode(data).decode('ascii')}"
    caption = name[:1].upper() + name[1:]
    image = element("div", element("img", src=source, alt=caption), class_="scroll", tabindex="0")
    kinds = "picture moving" if kind == "webp" else "picture"
    return element("figure", image, element("figcaption", caption), class_=kinds)
