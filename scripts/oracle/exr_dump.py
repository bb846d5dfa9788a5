"""What OpenImageIO reads from an image, as one JSON object on stdout.

    python exr_dump.py FILE --values OUT

Needs Blender's Python module, which carries OpenImageIO. OUT gets the pixels of all parts, in rows from the top, channels in
the order given, as little-endian f32.

Exits with 1 and a message on stderr when OpenImageIO does not accept the file.
"""

import argparse
import json
import sys

import bpy
import numpy as np

bpy.utils.expose_bundled_modules()
import OpenImageIO as oiio  # noqa: E402


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("file")
    parser.add_argument("--values", required=True)
    options = parser.parse_args()
    image = oiio.ImageInput.open(options.file)
    if image is None:
        sys.exit(oiio.geterror())
    parts = []
    with open(options.values, "wb") as out:
        while image.seek_subimage(len(parts), 0):
            spec = image.spec()
            pixels = image.read_image(len(parts), 0, 0, spec.nchannels, "float")
            if pixels is None:
                sys.exit(image.geterror())
            out.write(np.asarray(pixels, "<f4").tobytes())
            parts.append(
                {
                    "name": spec.getattribute("name") or spec.getattribute("oiio:subimagename"),
                    "size": [spec.width, spec.height],
                    "origin": [spec.x, spec.y],
                    "channels": list(spec.channelnames),
                    "format": str(spec.format),
                    "compression": spec.getattribute("compression"),
                    "vdbake": json.loads(spec.getattribute("vdbake") or "null"),
                }
            )
    json.dump({"format": image.format_name(), "parts": parts}, sys.stdout)


if __name__ == "__main__":
    main()
