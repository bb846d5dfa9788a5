"""What OpenVDB itself reads from a .vdb file, as one JSON object on stdout.

    python3 openvdb_dump.py FILE [--grid NAME --values OUT]

Needs OpenVDB's Python module: `pyopenvdb` (OpenVDB 10, Debian) or `openvdb` (OpenVDB 12, inside Blender's wheel).

--values writes every active value of one grid, tiles expanded, sorted by (x, y, z), as little-endian records of three
i32 for the voxel's index and one f32 (float grids) or three (vec3s grids).

Exits with 1 and a message on stderr when OpenVDB does not accept the file.
"""

import argparse
import json
import math
import sys

import numpy as np

try:
    import openvdb as vdb
except ImportError:
    try:
        import pyopenvdb as vdb
    except ImportError:
        import bpy

        bpy.utils.expose_bundled_modules()
        import openvdb as vdb

WINDOW = 128  # largest edge of the dense windows that values are copied through: 8 MiB of f32
MARKER = np.float32(3e38)


def plain(value):
    """A metadata value as JSON has it; what is not finite becomes text, which JSON can hold."""
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else str(value)
    if isinstance(value, (bool, int, str)):
        return value
    return str(value)


def describe(grid):
    """What is in a grid, but for its values."""
    transform = grid.transform
    origin = np.array(transform.indexToWorld((0, 0, 0)))
    axes = [np.array(transform.indexToWorld(tuple(axis))) - origin for axis in np.eye(3)]
    matrix = np.vstack([np.column_stack([*axes, origin]), [0, 0, 0, 1]])
    active = grid.activeVoxelCount()
    # Some versions read a truncated file without a word; the count that the writer noted gives it away.
    noted = grid.metadata.get("file_voxel_count", active)
    if noted != active:
        raise ValueError(f"grid {grid.name!r} has {active} active voxels, and {noted} by its metadata")
    low, high = grid.evalMinMax() if active else (None, None)
    return {
        "name": grid.name,
        "type": grid.valueTypeName,
        "class": grid.gridClass,
        "vector_type": grid.vectorType,
        "half": grid.saveFloatAsHalf,
        "background": plain(grid.background),
        "map": transform.typeName,
        "voxel_size": list(transform.voxelSize()),
        # For column vectors: world = M (i, j, k, 1).
        "index_to_world": matrix.tolist(),
        # Where the value at index (0, 0, 0) lies.
        "origin": origin.tolist(),
        "active_voxels": active,
        "tile_voxels": active - grid.activeLeafVoxelCount(),
        "leaves": grid.leafCount(),
        "bbox": [list(corner) for corner in grid.evalActiveVoxelBoundingBox()] if active else None,
        "leaf_bbox": [list(corner) for corner in grid.evalLeafBoundingBox()] if grid.leafCount() else None,
        "min": plain(low),
        "max": plain(high),
        "metadata": {key: plain(value) for key, value in grid.metadata.items()},
    }


def active_values(grid):
    """The active voxels' indices (n, 3) and values (n, channels), sorted by index.

    The module cannot copy active states into an array. So a copy of the grid gets MARKER for its background, which its
    inactive voxels follow (inside a level set with the sign turned). Where no voxel had that value before, those that
    do not have it now are the active ones and the inactive ones with a value of their own: the count tells whether
    there are any of the latter. A grid that does not fit is walked voxel by voxel.
    """
    channels = {"float": 1, "vec3s": 3}.get(grid.valueTypeName)
    if channels is None:
        raise ValueError(f"cannot list the values of a grid of {grid.valueTypeName}")
    count = grid.activeVoxelCount()
    if count == 0:
        return np.zeros((0, 3), np.int32), np.zeros((0, channels), np.float32)
    marked = grid.deepCopy()
    marked.background = float(MARKER) if channels == 1 else (float(MARKER),) * 3
    low, high = grid.evalActiveVoxelBoundingBox()
    # Small grids get small windows.
    window = [min(WINDOW, b - a + 1) for a, b in zip(low, high)]
    starts = [range(a, b + 1, edge) for a, b, edge in zip(low, high, window)]
    shape = (*window, 3) if channels == 3 else tuple(window)
    before, after = np.empty(shape, np.float32), np.empty(shape, np.float32)
    indices, values = [], []
    for corner in ((x, y, z) for x in starts[0] for y in starts[1] for z in starts[2]):
        marked.copyToArray(after, ijk=corner)
        voxels = after.reshape(*window, channels)
        where = np.nonzero(np.abs(voxels[..., 0]) != MARKER)
        if where[0].size:
            indices.append(np.stack(where, axis=1).astype(np.int32) + np.array(corner, np.int32))
            values.append(voxels[where])
        grid.copyToArray(before, ijk=corner)
        if (np.abs(before) == MARKER).any():
            return walked_values(grid, channels)
    indices, values = np.concatenate(indices), np.concatenate(values)
    return by_index(indices, values) if len(indices) == count else walked_values(grid, channels)


def walked_values(grid, channels):
    """The same, voxel by voxel."""
    indices, values = [], []
    for item in grid.citerOnValues():
        low, high = np.array(item.min), np.array(item.max)
        box = np.indices(high - low + 1).reshape(3, -1).T + low
        indices.append(box.astype(np.int32))
        values.append(np.full((len(box), channels), item.value, np.float32))
    return by_index(np.concatenate(indices), np.concatenate(values))


def by_index(indices, values):
    order = np.lexsort(indices.T[::-1])
    return indices[order], values[order]


def write_values(grid, path):
    indices, values = active_values(grid)
    record = np.dtype([("index", "<i4", 3), ("value", "<f4", values.shape[1:])])
    records = np.empty(len(indices), record)
    records["index"], records["value"] = indices, values
    records.tofile(path)


def dump(path, grid_name=None, values_path=None):
    """The report on a file; also writes a grid's values where a path is given."""
    grids, metadata = vdb.readAll(path)
    if values_path is not None:
        chosen = [grid for grid in grids if grid.name == grid_name]
        if len(chosen) != 1:
            raise ValueError(f"{len(chosen)} grids of the name {grid_name!r}")
        write_values(chosen[0], values_path)
    return {
        "openvdb": list(vdb.LIBRARY_VERSION),
        "metadata": {key: plain(value) for key, value in metadata.items()},
        "grids": [describe(grid) for grid in grids],
    }


def add_arguments(parser):
    parser.add_argument("file")
    parser.add_argument("--grid", default="density", help="the grid whose values to write")
    parser.add_argument("--values", metavar="OUT", help="where to write them")


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    add_arguments(parser)
    arguments = parser.parse_args()
    try:
        report = dump(arguments.file, arguments.grid, arguments.values)
    except Exception as error:  # what OpenVDB raises has no common type
        sys.exit(f"{arguments.file}: {type(error).__name__}: {error}")
    json.dump(report, sys.stdout, allow_nan=False)


if __name__ == "__main__":
    main()
