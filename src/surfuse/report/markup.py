"""HTML and SVG elements that escape every text given to them, so that no outside name can become markup."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping
from dataclasses import dataclass

VOID = frozenset({"br", "img", "input", "meta", "link", "hr"})


@dataclass(frozen=True)
class Markup:
    """Text that is markup already; anything else is escaped."""

    text: str

    def __str__(self) -> str:
        return self.text


Child = Markup | str
Value = str | int | float | bool
Attributes = Mapping[str, Value]


def _attribute(name: str, value: Value) -> str:
    if value is True:
        return f" {name}"
    if value is False:
        return ""
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return f' {name}="{html.escape(text, quote=True)}"'


def element(name: str, attributes: Attributes | None = None, *children: Child) -> Markup:
    """One element; str children and attribute values are escaped, Markup children are taken as they are.

    A True attribute stands alone, a False one is left out.
    """
    opening = name + "".join(_attribute(key, value) for key, value in (attributes or {}).items())
    if name in VOID:
        return Markup(f"<{opening}>")
    return Markup(f"<{opening}>{join(children)}</{name}>")


def join(children: tuple[Child, ...] | list[Child] | list[Markup], separator: str = "") -> Markup:
    """Put children one after the other, escaping those that are plain text."""
    parts = [child.text if isinstance(child, Markup) else html.escape(child, quote=True) for child in children]
    return Markup(separator.join(parts))


def script_json(value: object) -> str:
    """JSON that cannot end the script element it stands in: `<`, `>`, `&` and line separators are escaped.

    Raises
    ------
    ValueError : a number is nan or infinite, which JSON has no word for.
    """
    text = json.dumps(value, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
