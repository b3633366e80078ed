"""The main job: search, outline, plan, scan, fuse, map; and the paper, reproduced."""
