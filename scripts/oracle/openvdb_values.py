"""What OpenVDB itself reads from many .vdb files, as a JSON list on stdout: starting Python takes longer than reading.

    python3 openvdb_values.py FILE [FILE ...]

Each entry is the report that openvdb_dump.py gives; the values of grid `density` go to FILE.values, as by its --values.
"""

import json
import sys

from openvdb_dump import dump


def main():
    paths = sys.argv[1:]
    if not paths:
        sys.exit(__doc__)
    reports = []
    for path in paths:
        try:
            reports.append(dump(path, "density", f"{path}.values"))
        except Exception as error:  # what OpenVDB raises has no common type
            sys.exit(f"{path}: {type(error).__name__}: {error}")
    json.dump(reports, sys.stdout, allow_nan=False)


if __name__ == "__main__":
    main()
