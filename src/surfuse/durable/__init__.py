"""Files that appear whole or not at all, and stay after a power cut."""

from surfuse.durable.files import (
    refuse_existing,
    replace_file,
    replacing,
    storage_error,
    sync_folder,
    write_bytes,
    write_text,
)

__all__ = ["refuse_existing", "replace_file", "replacing", "storage_error", "sync_folder", "write_bytes", "write_text"]
