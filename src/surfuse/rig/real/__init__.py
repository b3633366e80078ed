"""The real rig, assembled from its cell file."""
