"""Renders a .vol file (`vdbake convert IN.vdb OUT.vol`) with Mitsuba 3, with the scene's medium, lights and camera:

    python scripts/mitsuba_render.py FILE.vol --scene SCENE.toml -o OUT.exr        # pip install mitsuba

The camera, the transmittance and what is scattered once are those of `vdbake`; ambient light is Mitsuba's `constant`
emitter, which the volume itself does shadow. Mitsuba's media do not emit light.
"""

import math
import os
import struct
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import numpy as np
import vdbake_view


def arguments():
    parser = vdbake_view.parser("Render a .vol file with Mitsuba.")
    parser.add_argument("file", metavar="FILE", help="a .vol file")
    parser.add_argument("--scene", metavar="SCENE", required=True, help="the scene that it was baked from")
    parser.add_argument("--time", type=float, metavar="T", help="seconds after the scene's start frame [0]")
    parser.add_argument("--variant", default="scalar_rgb", help="of Mitsuba")
    parser.add_argument("--integrator", default="volpath", choices=["volpath", "volpathmis"])
    parser.add_argument("--max-depth", type=int, default=8, metavar="N", help="scatterings, and one: 2 is scattering once")
    options = parser.parse_args()
    if not options.output or not options.output.lower().endswith((".exr", ".png")):
        parser.error("name a picture that ends in .exr or .png with -o")
    return options


def read_box(path):
    """The corners of a .vol file's box."""
    try:
        with open(path, "rb") as file:
            head = file.read(48)
    except OSError as error:
        sys.exit(f"{path}: {error.strerror}")
    if len(head) < 48 or head[:4] != b"VOL\x03":
        sys.exit(f"{path} is no .vol file of version 3")
    _, *_, channels = struct.unpack_from("<5i", head, 4)
    if channels != 1:
        sys.exit(f"{path} holds vectors, which are no density")
    box = np.array(struct.unpack_from("<6f", head, 24), float)
    return box[:3], box[3:]


def rgb(colour):
    return {"type": "rgb", "value": [float(part) for part in colour]}


def emitters(view):
    found = {}
    for number, light in enumerate(view["lights"]):
        if light["kind"] == "sun":
            direction = [float(part) for part in light["direction"]]
            found[f"light{number}"] = {
                "type": "directional",
                "direction": direction,
                "irradiance": rgb(light["irradiance"]),
            }
        elif light["kind"] == "point":
            found[f"light{number}"] = {
                "type": "point",
                "position": light["position"],
                "intensity": rgb(light["intensity"]),
            }
    ambient = vdbake_view.ambient(view)
    if any(ambient):
        found["ambient"] = {"type": "constant", "radiance": rgb(ambient)}
    return found


def sensor(mi, camera, size, samples):
    eye, forward = np.array(camera["eye"]), np.array(camera["forward"])
    place = mi.ScalarTransform4f().look_at(origin=list(eye), target=list(eye + forward), up=list(camera["up"]))
    half = camera["half"][0]
    found = {
        "type": "perspective",
        "near_clip": 1e-3,
        "far_clip": 1e6,
        "film": {
            "type": "hdrfilm",
            "width": size[0],
            "height": size[1],
            "pixel_format": "rgba",
            "component_format": "float32",
            # A pixel is the mean over itself.
            "rfilter": {"type": "box"},
        },
        "sampler": {"type": "independent", "sample_count": samples},
    }
    if camera["is_orthographic"]:
        # The film's shape sets the height already: both axes get the width's scale.
        return found | {"type": "orthographic", "to_world": place @ mi.ScalarTransform4f().scale([half, half, 1.0])}
    return found | {"fov": 2.0 * math.degrees(math.atan(half)), "fov_axis": "x", "to_world": place}


def build(mi, options, view):
    low, high = read_box(options.file)
    medium = view["medium"]
    box = mi.ScalarTransform4f().translate(list((low + high) / 2)) @ mi.ScalarTransform4f().scale(list((high - low) / 2))
    scene = {
        "type": "scene",
        "integrator": {
            "type": options.integrator,
            "max_depth": options.max_depth,
            # Paths are not ended by chance, which is noise.
            "rr_depth": 1000000,
            "hide_emitters": not options.absorption_only,
        },
        "sensor": sensor(mi, view["camera"], options.size, options.samples),
        **emitters(view),
    }
    if options.absorption_only:
        scene["background"] = {"type": "constant", "radiance": rgb([1.0] * 3)}
    if medium["extinction"] > 0.0:
        scene["volume"] = {
            "type": "cube",
            "to_world": box,
            "bsdf": {"type": "null"},
            "interior": {
                "type": "heterogeneous",
                # Without this the file's box is ignored for the unit cube.
                "sigma_t": {"type": "gridvolume", "filename": options.file, "use_grid_bbox": True},
                "scale": medium["extinction"],
                "albedo": {"type": "constvolume", "value": rgb(medium["albedo"])},
                "phase": {"type": "hg", "g": medium["anisotropy"]},
            },
        }
    return mi.load_dict(scene)


def over(pixels, background):
    """The picture on a background."""
    if background is None:
        return pixels
    alpha = pixels[..., 3:]
    colour = pixels[..., :3] + (1.0 - alpha) * np.array(background, np.float32)
    return np.concatenate([colour, np.ones_like(alpha)], axis=-1)


def write(mi, path, pixels, view):
    if path.lower().endswith(".exr"):
        mi.Bitmap(np.ascontiguousarray(pixels, np.float32)).write(path)
        return
    alpha = pixels[..., 3:]
    straight = np.divide(pixels[..., :3], alpha, out=np.zeros_like(pixels[..., :3]), where=alpha > 0.0)
    straight = np.clip(straight * 2.0 ** vdbake_view.stops(view, pixels), 0.0, 1.0)
    curve = np.where(straight <= 0.0031308, 12.92 * straight, 1.055 * straight ** (1 / 2.4) - 0.055)
    bytes_of = np.rint(255.0 * np.concatenate([curve, np.clip(alpha, 0.0, 1.0)], axis=-1)).astype(np.uint8)
    if view["camera"]["background"] is not None:
        bytes_of = bytes_of[..., :3]
    mi.Bitmap(np.ascontiguousarray(bytes_of)).write(path)


def main():
    options = arguments()
    view = vdbake_view.view(options)
    import mitsuba as mi

    mi.set_variant(options.variant)
    if any(view["medium"]["emission"]):
        print("note: the medium's own light is left out, since Mitsuba's media do not emit any", file=sys.stderr)
    if any(light["kind"] == "ambient" for light in view["lights"]):
        print("note: ambient light is shadowed here", file=sys.stderr)
    found = mi.render(build(mi, options, view), seed=options.seed, spp=options.samples)
    pixels = np.array(found, np.float32)
    write(mi, options.output, pixels if options.absorption_only else over(pixels, view["camera"]["background"]), view)


main()
