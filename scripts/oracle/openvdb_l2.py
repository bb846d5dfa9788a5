"""How far a .vdb file's density is from the truth, by OpenVDB's own look-up and nothing of this program's.

    python3 openvdb_l2.py FILE POINTS.npy                 # makes points over all that trilinear values show
    python3 openvdb_l2.py FILE POINTS.npy TRUTH.npy       # holds the file against the truth there

The second prints JSON: relative L2 of the trilinear values, its 95 % interval by the bootstrap, and the number of points.
"""

import json
import sys

import numpy as np

from openvdb_dump import vdb

COUNT = 40_000
DRAWS = 400


def points(grid):
    """Points spread evenly over the box of the active voxels and a voxel around it, in the world."""
    low, high = (np.array(corner, float) for corner in grid.evalActiveVoxelBoundingBox())
    places = np.random.default_rng(20_240_229).random((COUNT, 3))
    indices = low - 1 + places * (high - low + 2)
    return np.array([grid.transform.indexToWorld(tuple(index)) for index in indices.tolist()])


def trilinear(grid, world):
    """The values at points of the world, from the eight voxels around each."""
    accessor = grid.getConstAccessor()
    values = []
    for point in world.tolist():
        index = np.array(grid.transform.worldToIndex(tuple(point)))
        base = np.floor(index)
        part = index - base
        corner = [int(c) for c in base]
        value = 0.0
        for n in range(8):
            offset = [n >> 2 & 1, n >> 1 & 1, n & 1]
            weight = np.prod([p if o else 1 - p for o, p in zip(offset, part)])
            value += weight * accessor.getValue(tuple(c + o for c, o in zip(corner, offset)))
        values.append(value)
    return np.array(values)


def relative_l2(error, truth):
    return float(np.sqrt(np.mean(error**2) / np.mean(truth**2)))


def main():
    grid = vdb.read(sys.argv[1], "density")
    if len(sys.argv) == 3:
        np.save(sys.argv[2], points(grid))
        return
    world, truth = np.load(sys.argv[2]), np.load(sys.argv[3])
    error = trilinear(grid, world) - truth
    draw = np.random.default_rng(7)
    draws = []
    for _ in range(DRAWS):
        chosen = draw.integers(0, len(truth), len(truth))
        draws.append(relative_l2(error[chosen], truth[chosen]))
    low, high = np.percentile(draws, [2.5, 97.5])
    print(json.dumps({"l2": relative_l2(error, truth), "interval": [low, high], "points": len(truth)}))


main()
