"""What a check of the doctor says."""

from __future__ import annotations

Check = tuple[str, str, bool]
"""Its name, what was found, and whether that is well."""

HEARS_NOTHING = "hears nothing"
"""What is found of a sensor without an echo: no problem before an empty table, but worth a word in the result."""
