"""Search, station (one stop), scan (the walk through the plan)."""
