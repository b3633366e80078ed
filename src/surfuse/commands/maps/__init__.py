"""Maps and reports as files: shown, exported."""
