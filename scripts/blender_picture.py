"""Renders a baked density with Blender's Cycles: python scripts/blender_picture.py FILE.vdb OUT.png

Needs the `bpy` module (pip install bpy) or Blender itself (blender -b -P scripts/blender_picture.py -- FILE.vdb OUT.png).
The camera looks along +y and is framed to the volume's box; z is up, as in the file.
"""

import argparse
import math
import os
import sys

import bpy
from mathutils import Vector


def arguments():
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = argparse.ArgumentParser(description="Render the density of a VDB file with Cycles.")
    parser.add_argument("file")
    parser.add_argument("picture")
    parser.add_argument("--extinction", type=float, default=20.0, help="per metre at density 1")
    parser.add_argument("--color", type=float, nargs=3, default=(0.8, 0.8, 0.8), help="scattering albedo")
    parser.add_argument("--background", type=float, nargs=3, default=(0.03, 0.04, 0.06))
    parser.add_argument("--sun", type=float, nargs=3, default=(-1.0, 0.5, -0.6), help="the way the light travels")
    parser.add_argument("--strength", type=float, default=6.0, help="of the sun, W/m^2")
    parser.add_argument("--from", dest="eye", type=float, nargs=3, default=(0.0, -1.0, 0.1), help="direction of the eye")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 640))
    parser.add_argument("--samples", type=int, default=64)
    options = parser.parse_args(own)
    # Blender takes relative paths from elsewhere than the current folder.
    options.file, options.picture = os.path.abspath(options.file), os.path.abspath(options.picture)
    return options


def main():
    options = arguments()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene

    volume = bpy.data.volumes.new("density")
    volume.filepath = options.file
    if not volume.grids.load():
        sys.exit(f"{options.file}: {volume.grids.error_message}")
    box = bpy.data.objects.new("density", volume)
    scene.collection.objects.link(box)
    material = bpy.data.materials.new("density")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    principled = nodes.new("ShaderNodeVolumePrincipled")
    principled.inputs["Density"].default_value = options.extinction
    principled.inputs["Color"].default_value = (*options.color, 1.0)
    output = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(principled.outputs["Volume"], output.inputs["Volume"])
    volume.materials.append(material)

    # Without a world, Blender 5.0 renders volumes black.
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*options.background, 1.0)
    scene.world = world
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy = options.strength
    lamp = bpy.data.objects.new("sun", sun)
    lamp.rotation_euler = Vector(options.sun).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(lamp)

    shown = box.evaluated_get(bpy.context.evaluated_depsgraph_get())
    corners = [Vector(corner) for corner in shown.bound_box]
    centre = sum(corners, Vector()) / 8
    radius = max((corner - centre).length for corner in corners)
    camera = bpy.data.cameras.new("camera")
    camera.angle = math.radians(35)
    eye = bpy.data.objects.new("camera", camera)
    direction = Vector(options.eye).normalized()
    eye.location = centre + direction * radius / math.sin(camera.angle / 2) * 0.97
    eye.rotation_euler = (-direction).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(eye)
    scene.camera = eye

    scene.render.engine = "CYCLES"
    scene.cycles.samples = options.samples
    scene.cycles.use_denoising = False
    scene.cycles.volume_bounces = 6
    if hasattr(scene.cycles, "volume_biased"):
        scene.cycles.volume_biased = True
    scene.render.resolution_x, scene.render.resolution_y = options.size
    scene.render.filepath = options.picture
    bpy.ops.render.render(write_still=True)


main()
