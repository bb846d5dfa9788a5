"""What Blender makes of a .vdb file, as one JSON object on stdout.

    python blender_check.py FILE [--grid NAME --values OUT] [--points POINTS.json]

Runs under a Python that has Blender as the module `bpy`. The file is imported as a user would (File > Import > OpenVDB)
and every grid's voxels are loaded. `openvdb` in the report is what openvdb_dump.py says with Blender's own OpenVDB, and
--values is as there. --points names a JSON list of [x, y, z] in metres: `samples` holds every float grid's trilinear
value there, as Blender's geometry nodes give it.

Exits with 1 and a message on stderr when Blender does not load the file or a grid of it.
"""

import argparse
import json
import os
import sys

# Blender prints to stdout what it does; that must not get between the lines of the report.
report_fd = os.dup(1)
os.dup2(2, 1)

import bpy

sys.path.append(
    os.path.join(
        bpy.utils.resource_path("LOCAL"), "python", "lib", "python%d.%d" % sys.version_info[:2], "site-packages"
    )
)

import openvdb_dump


def load(path):
    """The file as an object of an else empty scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    path = os.path.abspath(path)
    bpy.ops.object.volume_import(
        filepath=path,
        directory=os.path.dirname(path),
        files=[{"name": os.path.basename(path)}],
        align="WORLD",
        location=(0, 0, 0),
    )
    volume = bpy.context.object
    if volume is None:
        raise RuntimeError("Blender does not import the file")
    grids = volume.data.grids
    if not grids.load():
        raise RuntimeError(f"Blender does not load the file: {grids.error_message}")
    for grid in grids:
        # The list loads with the metadata alone; voxels that cannot be read show only here.
        if not grid.load():
            raise RuntimeError(f"Blender does not load the grid {grid.name!r}: {grids.error_message}")
    return volume


def describe(grid):
    return {
        "name": grid.name,
        "type": grid.data_type,
        "channels": grid.channels,
        # For column vectors: object = M (i, j, k, 1).
        "index_to_object": [list(row) for row in grid.matrix_object],
    }


def world_box(volume):
    """The two corners of the evaluated object's bounds in the world."""
    evaluated = volume.evaluated_get(bpy.context.evaluated_depsgraph_get())
    corners = [evaluated.matrix_world @ type(evaluated.location)(corner) for corner in evaluated.bound_box]
    return [[pick(c[axis] for c in corners) for axis in range(3)] for pick in (min, max)]


def sample(volume, grid_name, points):
    """The grid's trilinear values at points of the world, through geometry nodes on a mesh of the points."""
    mesh = bpy.data.meshes.new("points")
    mesh.from_pydata(points, [], [])
    probe = bpy.data.objects.new("points", mesh)
    bpy.context.collection.objects.link(probe)

    tree = bpy.data.node_groups.new("sample", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="INPUT", socket_type="NodeSocketGeometry")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")

    def node(kind):
        return tree.nodes.new(kind)

    source = node("GeometryNodeObjectInfo")
    source.transform_space = "RELATIVE"
    source.inputs["Object"].default_value = volume
    get = node("GeometryNodeGetNamedGrid")
    get.data_type = "FLOAT"
    get.inputs["Name"].default_value = grid_name
    pick = node("GeometryNodeSampleGrid")
    pick.data_type = "FLOAT"
    position = node("GeometryNodeInputPosition")
    store = node("GeometryNodeStoreNamedAttribute")
    store.data_type, store.domain = "FLOAT", "POINT"
    store.inputs["Name"].default_value = "sample"
    for start, end in [
        (source.outputs["Geometry"], get.inputs["Volume"]),
        (get.outputs["Grid"], pick.inputs["Grid"]),
        (position.outputs["Position"], pick.inputs["Position"]),
        (node("NodeGroupInput").outputs["Geometry"], store.inputs["Geometry"]),
        (pick.outputs["Value"], store.inputs["Value"]),
        (store.outputs["Geometry"], node("NodeGroupOutput").inputs["Geometry"]),
    ]:
        tree.links.new(start, end)

    probe.modifiers.new("sample", "NODES").node_group = tree
    evaluated = probe.evaluated_get(bpy.context.evaluated_depsgraph_get())
    values = [item.value for item in evaluated.data.attributes["sample"].data]
    bpy.data.objects.remove(probe)
    if len(values) != len(points):
        raise RuntimeError(f"Blender sampled {len(values)} of {len(points)} points")
    return values


def check(arguments):
    volume = load(arguments.file)
    report = {
        "blender": bpy.app.version_string,
        "grids": [describe(grid) for grid in volume.data.grids],
        "world_box": world_box(volume),
        "openvdb": openvdb_dump.dump(arguments.file, arguments.grid, arguments.values),
    }
    if arguments.points is not None:
        with open(arguments.points, encoding="utf-8") as file:
            points = json.load(file)
        report["samples"] = {
            grid.name: sample(volume, grid.name, points)
            for grid in volume.data.grids
            if grid.data_type == "FLOAT"
        }
    return report


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    openvdb_dump.add_arguments(parser)
    parser.add_argument("--points", metavar="POINTS.json", help="where to sample the float grids")
    arguments = parser.parse_args()
    try:
        report = check(arguments)
    except Exception as error:  # what OpenVDB and Blender raise has no common type
        sys.exit(f"{arguments.file}: {type(error).__name__}: {error}")
    with os.fdopen(report_fd, "w") as out:
        json.dump(report, out, allow_nan=False)


if __name__ == "__main__":
    main()
