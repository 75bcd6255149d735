"""Tables as Parquet: whole or absent, kept to their contracts, verified when read.

`publication` is where they are and how they come there, `parquet` one file, `contract_check` the check of a
table's rows, `check` that of whole outputs, `naming` the safe name of a recording.
"""

from pipeline.storage.naming import recording_id
from pipeline.storage.parquet import Published, StorageError
from pipeline.storage.publication import (
    PART,
    PARTITION,
    PROVENANCE,
    Publication,
    load,
    publication,
    published,
    read,
    recordings,
    table_file,
)

__all__ = [
    "PART",
    "PARTITION",
    "PROVENANCE",
    "Publication",
    "Published",
    "StorageError",
    "load",
    "publication",
    "published",
    "read",
    "recording_id",
    "recordings",
    "table_file",
]
