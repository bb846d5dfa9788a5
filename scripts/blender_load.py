"""Loads a baked file into Blender, with its scene's medium, lights and camera, and renders it with Cycles:

    blender -b -P scripts/blender_load.py -- FILE.vdb -o OUT.exr
    python scripts/blender_load.py FILE.vdb -o OUT.png        # with Blender as a module: pip install bpy

For Blender 4.5 and 5.0. Without --scene the scene is the one in the file itself. Without -b Blender's window opens with the
scene in it. The camera, the transmittance and what is scattered once are those of `vdbake`; ambient light is Blender's
world, which the volume itself does shadow.
"""

import math
import os
import sys
import tempfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import bpy
import vdbake_view
from mathutils import Matrix, Vector


def arguments():
    own = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    parser = vdbake_view.parser("Load a baked file into Blender, and render it with Cycles.")
    parser.add_argument("file", metavar="FILE", help="a .vdb file")
    parser.add_argument("--scene", metavar="SCENE", help="the scene, instead of the one that the file carries")
    parser.add_argument("--grid", default="density", metavar="NAME", help="the grid that is the density")
    parser.add_argument("--save", metavar="OUT.blend", help="keep what was loaded as Blender's own file")
    parser.add_argument("--max-depth", type=int, default=8, metavar="N", help="scatterings, and one: 2 is scattering once")
    parser.add_argument("--denoise", action="store_true", help="smooth the noise away, and some of what is fine")
    parser.add_argument("--step", type=float, default=0.5, metavar="VOXELS", help="length of the steps through the volume")
    parser.add_argument(
        "--unbiased", action="store_true", help="let Blender 5.0 track the volume without steps, with more noise"
    )
    options = parser.parse_args(own)
    if options.output and not options.output.lower().endswith((".exr", ".png")):
        parser.error("OUT ends in neither .exr nor .png")
    if options.max_depth < 2:
        parser.error("--max-depth is at least 2")
    if bpy.app.background and not (options.output or options.save):
        parser.error("nothing to do: name a picture with -o, or a .blend file with --save")
    return options


def node_tree(of):
    """The nodes of a material or a world, which Blender 4.5 does not have from the start and later ones do."""
    if of.node_tree is None:
        of.use_nodes = True
    of.node_tree.nodes.clear()
    return of.node_tree


def scaled(colour):
    """A colour as Blender takes it for lights: its largest part, and the rest of it."""
    most = max(colour)
    return most, [part / most for part in colour] if most > 0.0 else [1.0] * 3


def add_volume(scene, options, medium):
    volume = bpy.data.volumes.new("density")
    # Blender takes relative paths from elsewhere than the current folder.
    volume.filepath = os.path.abspath(options.file)
    if not volume.grids.load():
        sys.exit(f"{options.file}: {volume.grids.error_message}")
    if options.grid not in volume.grids:
        sys.exit(f"{options.file} has no grid {options.grid!r}, only {', '.join(grid.name for grid in volume.grids)}")
    # By default values are rounded to 16 bits, and those below 0.001 cut off.
    volume.render.precision = "FULL"
    volume.render.clipping = 0.0

    material = bpy.data.materials.new("density")
    tree = node_tree(material)
    principled = tree.nodes.new("ShaderNodeVolumePrincipled")
    principled.inputs["Density Attribute"].default_value = options.grid
    principled.inputs["Density"].default_value = medium["extinction"]
    principled.inputs["Color"].default_value = (*medium["albedo"], 1.0)
    principled.inputs["Absorption Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    principled.inputs["Anisotropy"].default_value = medium["anisotropy"]
    strength, colour = scaled(medium["emission"])
    if strength > 0.0:
        # The node does not multiply its emission by the density.
        density = tree.nodes.new("ShaderNodeAttribute")
        density.attribute_name = options.grid
        times = tree.nodes.new("ShaderNodeMath")
        times.operation = "MULTIPLY"
        times.inputs[1].default_value = strength
        tree.links.new(density.outputs["Fac"], times.inputs[0])
        tree.links.new(times.outputs["Value"], principled.inputs["Emission Strength"])
        principled.inputs["Emission Color"].default_value = (*colour, 1.0)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(principled.outputs["Volume"], output.inputs["Volume"])
    volume.materials.append(material)
    thing = bpy.data.objects.new("density", volume)
    if bpy.app.version < (5, 0, 0):
        # Cycles of Blender 4.5 draws every value half a voxel further along all axes than the file places it.
        half = volume.grids[options.grid].matrix_object.to_3x3() @ Vector((0.5, 0.5, 0.5))
        thing.location = -half
    scene.collection.objects.link(thing)


def add_light(scene, light):
    if light["kind"] == "sun":
        lamp = bpy.data.lights.new("sun", "SUN")
        lamp.energy, lamp.color = scaled(light["irradiance"])
        lamp.angle = 0.0
        place = Vector(light["direction"]).to_track_quat("-Z", "Y").to_matrix().to_4x4()
    else:
        lamp = bpy.data.lights.new("point", "POINT")
        # Watts of a lamp that shines alike to all sides.
        intensity, lamp.color = scaled(light["intensity"])
        lamp.energy = 4.0 * math.pi * intensity
        lamp.shadow_soft_size = 0.0
        place = Matrix.Translation(light["position"])
    thing = bpy.data.objects.new(light["kind"], lamp)
    thing.matrix_world = place
    scene.collection.objects.link(thing)


def add_world(scene, ambient, background):
    # Without a world, Blender 5.0 renders volumes black.
    world = bpy.data.worlds.new("world")
    scene.world = world
    tree = node_tree(world)

    def shade(colour):
        node = tree.nodes.new("ShaderNodeBackground")
        node.inputs["Color"].default_value = (*colour, 1.0)
        return node.outputs["Background"]

    output = tree.nodes.new("ShaderNodeOutputWorld")
    if background is None:
        scene.render.film_transparent = True
        tree.links.new(shade(ambient), output.inputs["Surface"])
        return
    # Seen by the camera, but no light.
    mix = tree.nodes.new("ShaderNodeMixShader")
    tree.links.new(tree.nodes.new("ShaderNodeLightPath").outputs["Is Camera Ray"], mix.inputs["Fac"])
    tree.links.new(shade(ambient), mix.inputs[1])
    tree.links.new(shade(background), mix.inputs[2])
    tree.links.new(mix.outputs["Shader"], output.inputs["Surface"])
    if not any(ambient):
        world.cycles.sampling_method = "NONE"


def add_camera(scene, view, size):
    camera = bpy.data.cameras.new("camera")
    camera.sensor_fit = "HORIZONTAL"
    if view["is_orthographic"]:
        camera.type = "ORTHO"
        camera.ortho_scale = 2.0 * view["half"][0]
    else:
        camera.angle_x = 2.0 * math.atan(view["half"][0])
    camera.clip_start, camera.clip_end = 1e-3, 1e6
    thing = bpy.data.objects.new("camera", camera)
    right, up, back = view["right"], view["up"], [-part for part in view["forward"]]
    thing.matrix_world = Matrix([*zip(right, up, back, view["eye"]), (0.0, 0.0, 0.0, 1.0)])
    scene.collection.objects.link(thing)
    scene.camera = thing
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.resolution_percentage = 100


def set_up_cycles(scene, options):
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.samples, cycles.seed = options.samples, options.seed
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = options.denoise
    cycles.volume_bounces = options.max_depth - 2
    cycles.max_bounces = max(cycles.max_bounces, options.max_depth)
    # No light is lost to speed: nothing is clamped or left out.
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.light_sampling_threshold = 0.0
    # A pixel is the mean over itself.
    cycles.pixel_filter_type = "BOX"
    cycles.volume_max_steps = 65536
    if hasattr(cycles, "volume_biased"):
        cycles.volume_biased = not options.unbiased
    cycles.volume_step_rate = options.step


def render(scene, options, view):
    out = os.path.abspath(options.output)
    scene.view_settings.view_transform = "Standard"
    scene.render.dither_intensity = 0.0
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGBA", "32"
    settings.exr_codec = "ZIP"
    if out.lower().endswith(".exr"):
        scene.render.filepath = out
        bpy.ops.render.render(write_still=True)
        return
    with tempfile.TemporaryDirectory() as folder:
        scene.render.filepath = os.path.join(folder, "linear.exr")
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(scene.render.filepath)
        scene.view_settings.exposure = vdbake_view.stops(view, pixels(image))
        settings.file_format, settings.color_depth = "PNG", "8"
        settings.color_mode = "RGBA" if view["camera"]["background"] is None else "RGB"
        settings.compression = 100
        image.save_render(out, scene=scene)


def pixels(image):
    import numpy as np

    found = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(found)
    return found.reshape(-1, 4)


def main():
    options = arguments()
    view = vdbake_view.view(options)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    add_volume(scene, options, view["medium"])
    for light in view["lights"]:
        if light["kind"] != "ambient":
            add_light(scene, light)
    add_world(scene, vdbake_view.ambient(view), view["camera"]["background"])
    add_camera(scene, view["camera"], options.size)
    set_up_cycles(scene, options)
    if options.save:
        bpy.ops.wm.save_as_mainfile(filepath=os.path.abspath(options.save))
    if options.output:
        render(scene, options, view)


main()
