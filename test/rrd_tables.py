# SPDX-License-Identifier: Apache-2.0
"""What a file of the view holds, as tables."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import pyarrow as pa
from rerun.chunk import RrdReader


def rrd_tables(path: Path) -> tuple[dict[str, pa.Table], dict[str, pa.RecordBatch]]:
    """Return what the file holds: per entity one table of all rows over time, and one of what is static."""
    moving, static = defaultdict(list), {}
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        if chunk.is_static:
            static[chunk.entity_path] = batch
        else:
            moving[chunk.entity_path].append(batch)
    return {entity: pa.Table.from_batches(parts) for entity, parts in moving.items()}, static
