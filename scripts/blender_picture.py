"""Renders a baked density with Blender's Cycles: python scripts/blender_picture.py FILE.vdb OUT.png [--scene SCENE.toml]

Needs the `bpy` module (pip install bpy) or Blender itself (blender -b -P scripts/blender_picture.py -- FILE.vdb OUT.png).
Medium, camera and lights are the scene's, if one is given; options come before it. The camera looks along +y and is framed to
the volume's box unless something else is said; z is up, as in the file.
"""

import argparse
import math
import os
import sys
import tomllib

import bpy
from mathutils import Vector

MEDIUM = {"extinction": 20.0, "albedo": 0.9, "anisotropy": 0.0}
LIGHT = {"direction": (-1.0, 0.6, -0.8), "irradiance": 1.0}


def arguments():
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = argparse.ArgumentParser(description="Render the density of a VDB file with Cycles.")
    parser.add_argument("file")
    parser.add_argument("picture")
    parser.add_argument("--scene", help="the TOML file whose [medium], [camera] and [[light]] are to be used")
    parser.add_argument("--extinction", type=float, help="per metre at density 1")
    parser.add_argument("--color", type=float, nargs=3, help="scattering albedo")
    parser.add_argument("--background", type=float, nargs=3, default=(0.008, 0.011, 0.018))
    parser.add_argument("--sun", type=float, nargs=3, help="the way the light travels")
    parser.add_argument("--strength", type=float, default=8.0, help="of a sun whose irradiance is 1, W/m^2")
    parser.add_argument("--from", dest="eye", type=float, nargs=3, help="direction of the eye")
    parser.add_argument("--size", type=int, nargs=2, default=(640, 640))
    parser.add_argument("--samples", type=int, default=64)
    return parser.parse_args(own)


def read_scene(options):
    if not options.scene:
        return {"light": [LIGHT]}
    with open(options.scene, "rb") as file:
        return tomllib.load(file)


def add_volume(scene, path, medium, color):
    volume = bpy.data.volumes.new("density")
    # Blender takes relative paths from elsewhere than the current folder.
    volume.filepath = os.path.abspath(path)
    if not volume.grids.load():
        sys.exit(f"{path}: {volume.grids.error_message}")
    material = bpy.data.materials.new("density")
    material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    principled = nodes.new("ShaderNodeVolumePrincipled")
    principled.inputs["Density"].default_value = medium["extinction"]
    principled.inputs["Color"].default_value = (*color, 1.0)
    principled.inputs["Anisotropy"].default_value = medium["anisotropy"]
    output = nodes.new("ShaderNodeOutputMaterial")
    material.node_tree.links.new(principled.outputs["Volume"], output.inputs["Volume"])
    volume.materials.append(material)
    box = bpy.data.objects.new("density", volume)
    scene.collection.objects.link(box)
    return box


def add_sun(scene, direction, irradiance, strength):
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy = strength
    sun.color = irradiance if isinstance(irradiance, list) else [irradiance] * 3
    lamp = bpy.data.objects.new("sun", sun)
    lamp.rotation_euler = Vector(direction).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(lamp)


def add_camera(scene, box, view, direction):
    shown = box.evaluated_get(bpy.context.evaluated_depsgraph_get())
    corners = [Vector(corner) for corner in shown.bound_box]
    centre = Vector(view["look_at"]) if "look_at" in view else sum(corners, Vector()) / 8
    if direction is None:
        direction = Vector(view["position"]) - centre if "position" in view else (0.0, -1.0, 0.1)
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "HORIZONTAL"
    camera.angle = math.radians(view.get("fov", 35))
    eye = bpy.data.objects.new("camera", camera)
    eye.rotation_euler = (-Vector(direction)).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(eye)
    scene.camera = eye
    if "position" in view:
        eye.location = view["position"]
    else:
        # A little more than the box, so that nothing touches the edge.
        room = [coordinate for corner in corners for coordinate in centre + (corner - centre) * 1.05]
        bpy.context.view_layer.update()
        eye.location, _ = eye.camera_fit_coords(bpy.context.evaluated_depsgraph_get(), room)


def main():
    options = arguments()
    given = read_scene(options)
    medium = MEDIUM | given.get("medium", {})
    if options.extinction is not None:
        medium["extinction"] = options.extinction
    lights = [LIGHT | light for light in given.get("light", [])]
    if options.sun:
        lights = [{"direction": options.sun, "irradiance": 1.0}]

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = options.size
    box = add_volume(scene, options.file, medium, options.color or [medium["albedo"]] * 3)
    # Without a world, Blender 5.0 renders volumes black.
    world = bpy.data.worlds.new("world")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (*options.background, 1.0)
    scene.world = world
    for light in lights:
        add_sun(scene, light["direction"], light["irradiance"], options.strength)
    add_camera(scene, box, given.get("camera", {}), options.eye)

    scene.render.engine = "CYCLES"
    scene.cycles.samples = options.samples
    scene.cycles.use_denoising = True
    scene.cycles.volume_bounces = 6
    if hasattr(scene.cycles, "volume_biased"):
        scene.cycles.volume_biased = True
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.color_mode = "RGB"
    scene.render.image_settings.compression = 100
    scene.render.dither_intensity = 0.0
    scene.render.filepath = os.path.abspath(options.picture)
    bpy.ops.render.render(write_still=True)


main()
