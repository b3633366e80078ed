"""What fusion methods are made of: columns, the per-stop adapter, sites, supports, their own uncertainty."""
