"""The bridge by which any robot and any sensor join: one JSON object a line; see docs/reference/bridge.md."""
