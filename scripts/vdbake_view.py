"""What the scripts that render share: the scene as `vdbake info` tells it, and their arguments."""

import argparse
import json
import os
import shutil
import subprocess
import sys


def parser(description):
    """A parser with the arguments that all of them take."""
    found = argparse.ArgumentParser(
        description=description, formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    found.add_argument("-o", "--output", metavar="OUT", help="the picture: linear floats as .exr, or for the eye as .png")
    found.add_argument("--size", type=size, default=(960, 540), metavar="WxH", help="pixels of the picture")
    found.add_argument("--samples", type=int, default=64, metavar="N", help="samples for each pixel")
    found.add_argument("--seed", type=int, default=0, metavar="N", help="of the samples")
    found.add_argument(
        "--absorption-only",
        action="store_true",
        help="show the transmittance: no light but a white background of radiance 1, and nothing scattered",
    )
    found.add_argument("--extinction", type=float, metavar="E", help="per metre at density 1, instead of the scene's")
    found.add_argument("--exposure", type=float, metavar="STOPS", help="of a .png, instead of the scene's")
    found.add_argument(
        "--background", type=float, nargs=3, metavar=("R", "G", "B"), help="radiance behind everything, instead of the scene's"
    )
    found.add_argument(
        "--ambient", type=float, nargs=3, metavar=("R", "G", "B"), help="radiance from everywhere, besides the scene's lights"
    )
    found.add_argument("--vdbake", metavar="PATH", help="the program [in PATH, else in target/release of this project]")
    return found


def size(text):
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and int(width) > 0 and int(height) > 0):
        raise argparse.ArgumentTypeError("expected pixels, such as 960x540")
    return int(width), int(height)


def program(given):
    """The vdbake program."""
    if given:
        return given
    project = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "target", "release", "vdbake")
    found = shutil.which("vdbake") or (project if os.path.exists(project) else None)
    if found is None:
        sys.exit("there is no vdbake in PATH nor in target/release: name it with --vdbake, or build it (cargo build --release)")
    return found


def info(options, file, *more):
    """What vdbake tells of a scene or a baked file."""
    pixels = "%dx%d" % options.size
    command = [program(options.vdbake), "info", file, "--json", "--quiet", "--size", pixels, *more]
    try:
        done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, encoding="utf-8", check=False)
    except OSError as error:
        sys.exit(f"cannot run {command[0]}: {error}")
    if done.returncode != 0:
        sys.exit(done.stderr or f"{command[0]} failed with {done.returncode}")
    return json.loads(done.stdout)


def view(options):
    """The view of the scene that is asked for, at the time of the file if that is a baked one; else of that in the file."""
    settings, found = {}, None
    if options.file.lower().endswith(".vdb"):
        baked = info(options, options.file)
        settings = json.loads(baked["metadata"].get("vdbake_settings", "{}"))
        found = baked["view"]
    if options.scene:
        time = options.time if getattr(options, "time", None) is not None else settings.get("time", 0.0)
        found = info(options, options.scene, "--time", repr(float(time)))["view"]
    if found is None:
        sys.exit(f"the scene in {options.file} cannot be read, perhaps for want of files that it names: name it with --scene")
    if options.extinction is not None:
        found["medium"]["extinction"] = options.extinction
    if options.absorption_only:
        found["medium"].update(albedo=[0.0] * 3, emission=[0.0] * 3)
        found["camera"]["background"] = [1.0] * 3
        found["lights"] = []
        return found
    if options.exposure is not None:
        found["camera"]["exposure"] = options.exposure
    if options.background is not None:
        found["camera"]["background"] = options.background
    if options.ambient is not None:
        found["lights"].append({"kind": "ambient", "radiance": options.ambient})
    return found


def ambient(found):
    """The radiance of all ambient lights together."""
    lights = [light["radiance"] for light in found["lights"] if light["kind"] == "ambient"]
    return [sum(light[part] for light in lights) for part in range(3)]


def stops(found, pixels):
    """The exposure of a picture for the eye: the scene's, else one by which all but the brightest hundredth of what is seen
    of the volume is below 0.7. `pixels` are an array of shape (..., 4), premultiplied."""
    import numpy as np

    camera = found["camera"]
    if camera["exposure"] is not None:
        return camera["exposure"]
    seen = pixels[..., 3] > 0.02
    if camera["background"] is not None:
        behind = np.array(camera["background"])
        seen &= np.abs(pixels[..., :3] - behind).max(axis=-1) > 0.02 * behind.max()
    light = (pixels[..., :3] @ np.array([0.2126, 0.7152, 0.0722]))[seen] / pixels[..., 3][seen]
    white = np.quantile(light, 0.99) if light.size else 0.0
    return float(np.clip(np.log2(0.7 / white), -10.0, 10.0)) if white > 0.0 else 0.0
