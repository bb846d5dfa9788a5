"""Makes .vdb files with OpenVDB's Python module: every type of value it has, and all that a tree can hold.

    python3 openvdb_make.py FOLDER

Prints the files' names, a line each. The values are pseudo-random from fixed seeds.
"""

import os
import sys

import numpy as np

from openvdb_dump import vdb

# What inactive voxels may hold, as multiples of the background (1) and of another number: each list of them leads to
# another way of storing a node.
INACTIVE = [[1], [-1], [0.25], [1, -1], [1, 0.25], [0.25, 0.75], [1, 0.25, 0.75]]

MAPS = {
    "uniform": [[0.5, 0, 0, 0], [0, 0.5, 0, 0], [0, 0, 0.5, 0], [0, 0, 0, 1]],
    "uniform_translate": [[0.1, 0, 0, 0], [0, 0.1, 0, 0], [0, 0, 0.1, 0], [1, -2, 0.05, 1]],
    "scale": [[0.5, 0, 0, 0], [0, 0.25, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]],
    "scale_translate": [[0.5, 0, 0, 0], [0, 0.25, 0, 0], [0, 0, 2, 0], [3, 4, 5, 1]],
    "affine": [[0.5, 0.1, 0, 0], [-0.2, 0.25, 0.3, 0], [0, 0.4, 2, 0], [3, 4, 5, 1]],
}


def values_of(grid, rng):
    """A function from a number to a value of the grid's type, and one that gives a random number."""
    kind = grid.valueTypeName
    if kind == "bool":
        return bool, lambda: rng.integers(0, 2)
    if kind in ("int32", "int64"):
        return lambda x: int(x * 40), lambda: rng.integers(-(2**20), 2**20)
    if kind == "vec3i":
        return lambda x: (int(x * 40), int(x * 80), -int(x * 40)), lambda: rng.integers(-(2**20), 2**20)
    if kind in ("vec3s", "vec3d"):
        return lambda x: (float(x), 2 * float(x), -float(x)), rng.standard_normal
    return float, rng.standard_normal


def varied(grid_type, name, background):
    """Leaves with every kind of inactive value, tiles active and inactive at every level, in all octants."""
    rng = np.random.default_rng(1)
    grid = grid_type()
    value, number = values_of(grid, rng)
    grid.background = value(background)
    grid.name = name
    # Tiles of 4096^3, 128^3 and 8^3 voxels.
    grid.fill((4096, 0, 0), (8191, 4095, 4095), value(0.5), True)
    grid.fill((-4096, -4096, 4096), (-1, -1, 8191), value(0.75), False)
    grid.fill((-256, -256, -256), (-1, -129, -129), value(0.25), True)
    grid.fill((256, -256, 0), (511, -129, 127), value(0.75), False)
    grid.fill((640, 8, 16), (671, 39, 47), value(0.125), True)
    grid.fill((680, 8, 16), (703, 39, 47), value(0.5), False)
    accessor = grid.getAccessor()
    for number_of_leaf, factors in enumerate([*INACTIVE, *INACTIVE]):
        density = 0.4 if number_of_leaf < len(INACTIVE) else 0.02
        corner = np.array([-64 + 24 * number_of_leaf, 16 - 8 * number_of_leaf, -8])
        for offset in np.ndindex(8, 8, 8):
            index = tuple(int(c) for c in corner + offset)
            if rng.random() < density:
                accessor.setValueOn(index, value(number()))
            elif factors != [1]:
                factor = factors[rng.integers(len(factors))]
                accessor.setValueOff(index, value(background * factor if abs(factor) == 1 else factor))
    # A leaf that is active throughout, one without an active voxel, and voxels far away.
    for offset in np.ndindex(8, 8, 8):
        accessor.setValueOn(tuple(c - 800 for c in offset), value(number()))
        accessor.setValueOff(tuple(c + 800 for c in offset), value(0.25 if sum(offset) % 2 else 0.75))
    for index in [(-(2**31), 0, 0), (2**31 - 1, 2**31 - 1, 2**31 - 1), (123456, -65536, 77)]:
        accessor.setValueOn(index, value(1.5))
    return grid


def main():
    folder = sys.argv[1]

    def write(name, grids, metadata={}):
        vdb.write(os.path.join(folder, name), grids, metadata)
        print(name)

    for grid_type in vdb.GridTypes:
        if "Point" in grid_type.__name__:
            continue
        kind = grid_type.valueTypeName if isinstance(grid_type.valueTypeName, str) else grid_type.__name__.lower()
        grids = [varied(grid_type, "zero", 0), varied(grid_type, "other", 1)]
        write(f"varied_{kind}.vdb", grids)

    rng = np.random.default_rng(2)
    sphere = vdb.createLevelSetSphere(radius=20.0, center=(-3.0, 4.0, 5.0), voxelSize=0.7, halfWidth=3.0)
    sphere.name = "sphere"
    wave = vdb.FloatGrid()
    wave.name = "wave"
    array = rng.standard_normal((70, 40, 50)).astype(np.float32)
    wave.copyFromArray(np.where(array > 0.3, array, 0).astype(np.float32), ijk=(-33, -7, 4))
    wave.gridClass = vdb.GridClass.FOG_VOLUME
    wave["artist"] = "somebody"
    wave["count"] = 7
    wave["scale"] = 0.1
    wave["is_shown"] = True
    velocity = vdb.Vec3SGrid()
    velocity.name = "velocity"
    velocity.copyFromArray(rng.standard_normal((30, 20, 25, 3)).astype(np.float32), ijk=(-9, 100, -130))
    empty = vdb.FloatGrid(3.5)
    empty.name = "empty"
    shared = sphere.copy()
    shared.name = "shared"
    shared.transform = vdb.createLinearTransform(MAPS["affine"])
    same = wave.deepCopy()
    write("several.vdb", [sphere, wave, velocity, empty, shared, same], {"creator": "openvdb_make", "answer": 42})
    maps = []
    for name, matrix in MAPS.items():
        grid = sphere.deepCopy()
        grid.name = name
        grid.transform = vdb.createLinearTransform(matrix)
        maps.append(grid)
    frustum = wave.deepCopy()
    frustum.name = "frustum"
    frustum.transform = vdb.createFrustumTransform((0, 0, 0), (100, 100, 100), 0.5, 10.0)
    write("maps.vdb", [*maps, frustum])


if __name__ == "__main__":
    main()
