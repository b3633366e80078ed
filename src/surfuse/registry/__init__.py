"""Name -> plug-in, for every plug-in folder and for the plug-ins of other packages."""

from surfuse.registry.folders import KINDS, NOUNS, found, load, names
from surfuse.registry.listed import Listed, Listing, listing
from surfuse.registry.plain_values import parameters

__all__ = ["KINDS", "NOUNS", "Listed", "Listing", "found", "listing", "load", "names", "parameters"]
