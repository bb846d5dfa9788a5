"""What OpenVDB itself finds at given indices of .vdb files, and what it says of their grids.

    python3 openvdb_probe.py FILE POINTS OUT [FILE POINTS OUT ...]

POINTS holds indices, three little-endian i32 each. OUT gets, grid by grid in the order of the file and point by point, a
record of three f64 for the value (a number stands in the first) and one byte for its state, 1 for active.

Prints a JSON list, for each file the report that openvdb_dump.py gives.
"""

import json
import sys

import numpy as np

import openvdb_dump
from openvdb_dump import plain, vdb

RECORD = np.dtype([("value", "<f8", 3), ("active", "u1")])


def probe(grid, points):
    """The records of a grid at these points."""
    accessor = grid.getConstAccessor()
    records = np.zeros(len(points), RECORD)
    values, active = [], []
    for point in points.tolist():
        value, on = accessor.probeValue(tuple(point))
        values.append(tuple(value) if isinstance(value, (tuple, list)) else (value, 0, 0))
        active.append(on)
    if values:
        records["value"], records["active"] = values, active
    return records


def report(path, points_path, out_path):
    grids, metadata = vdb.readAll(path)
    points = np.fromfile(points_path, "<i4").reshape(-1, 3)
    np.concatenate([np.zeros(0, RECORD), *(probe(grid, points) for grid in grids)]).tofile(out_path)
    return {
        "metadata": {key: plain(value) for key, value in metadata.items()},
        "grids": [openvdb_dump.describe(grid) for grid in grids],
    }


def main():
    paths = sys.argv[1:]
    if not paths or len(paths) % 3:
        sys.exit(__doc__)
    reports = []
    for at in range(0, len(paths), 3):
        try:
            reports.append(report(*paths[at : at + 3]))
        except Exception as error:  # what OpenVDB raises has no common type
            sys.exit(f"{paths[at]}: {type(error).__name__}: {error}")
    json.dump(reports, sys.stdout, allow_nan=False)


if __name__ == "__main__":
    main()
