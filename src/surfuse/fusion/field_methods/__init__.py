"""What the methods of the field share: readings in the part frame, their support, sites, places of a map."""
