"""The Python door: what `import surfuse` offers, thin over the commands. Arrays in, arrays out.

No call reads a configuration file that it was not given, sets up logging or keeps state. Nothing here is imported
before it is used, see `surfuse.__getattr__`.
"""
