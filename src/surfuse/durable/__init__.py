"""Files that appear whole or not at all, and stay after a power cut."""

from surfuse.durable.files import (
    ExistingFileError,
    refuse_existing,
    replace_file,
    replacing,
    storage_error,
    sync_folder,
    write_bytes,
    write_text,
)

__all__ = [
    "ExistingFileError",
    "refuse_existing",
    "replace_file",
    "replacing",
    "storage_error",
    "sync_folder",
    "write_bytes",
    "write_text",
]
