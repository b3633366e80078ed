"""What a check of the doctor says."""

from __future__ import annotations

Check = tuple[str, str, bool]
"""Its name, what was found, and whether that is well."""
