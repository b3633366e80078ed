"""One check for the numbers that a method is given."""

from __future__ import annotations

from surfuse.errors import ConfigError


def check_within(owner: str, name: str, value: float, low: float, high: float, *, above: bool = False) -> None:
    """Refuse a parameter outside low <= value <= high (low < value with `above`), nan included.

    Raises
    ------
    ConfigError : names the parameter, the value and the limits.
    """
    fits = (low < value if above else low <= value) and value <= high
    if not fits:
        sign = "<" if above else "<="
        limits = f"{low:g} {sign} {name}" + ("" if high == float("inf") else f" <= {high:g}")
        raise ConfigError(f"{owner}: {name} = {value:g}", cure=f"give {limits}")
