"""The digital twin's truth: cell and parts as meshes, echoes, images. Seen only by what builds the twin."""
