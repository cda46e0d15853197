"""Numbers as text for readers."""

from __future__ import annotations

SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def readable(value: float) -> str:
    """Whole numbers in full, others in three significant digits, without exponent where that stays short."""
    if value == 0 or isinstance(value, int):
        return _spaced(value)
    if not 1e-4 <= abs(value) < 1e7:
        mantissa, exponent = f"{value:.2e}".split("e")
        return f"{mantissa} · 10{str(int(exponent)).translate(SUPERSCRIPTS)}"
    rounded = f"{value:#.3g}".rstrip(".")
    return _spaced(value) if "e" in rounded else rounded


def plain_number(value: float) -> str:
    """A value as short as a tick's label: 0.05, 2, 1 000, and 10⁻⁶ beyond that."""
    if value == 0 or 1e-3 <= abs(value) < 1e4:
        return f"{value:.3g}" if abs(value) < 1000 else f"{value:,.0f}".replace(",", "\u2009")
    mantissa, exponent = f"{value:.0e}".split("e")
    power = "10" + str(int(exponent)).translate(SUPERSCRIPTS)
    return power if mantissa == "1" else f"{mantissa}·{power}"


def counted(count: int, what: str) -> str:
    """How many there are of something, such as `1 number` and `10 numbers`."""
    return f"{_spaced(count)} {what}{'' if count == 1 else 's'}"


def _spaced(value: float) -> str:
    """A number without decimals, its thousands apart by narrow no-break spaces."""
    return f"{value:,.0f}".replace(",", "\u202f")
