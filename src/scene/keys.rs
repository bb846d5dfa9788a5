//! Every key of the format, table by table.

/// A kind of table: how it is written, and the keys it takes.
#[derive(Debug)]
pub(super) struct Section {
    /// As it is written in a scene.
    pub(super) name: &'static str,
    /// The keys that this version reads.
    pub(super) keys: &'static [&'static str],
    /// Keys that the format has but this version does not read, with what to do instead.
    pub(super) later: &'static [(&'static str, &'static str)],
}

pub(super) static ROOT: Section = Section {
    name: "the top level",
    keys: &["name", "bake", "time", "overlap", "tube", "medium", "camera", "light"],
    later: &[],
};

pub(super) static BAKE: Section = Section {
    name: "[bake]",
    keys: &["resolution", "voxel_size", "grids", "cutoff", "octave_fade", "widen", "antialias"],
    later: &[],
};

pub(super) static TIME: Section = Section { name: "[time]", keys: &["fps", "start", "end"], later: &[] };

pub(super) static TUBE: Section = Section {
    name: "[[tube]]",
    keys: &[
        "name",
        "curve",
        "radius",
        "twist",
        "spin",
        "stretch",
        "frame",
        "caps",
        "conserve",
        "rest",
        "overlap",
        "envelope",
        "layer",
        "color",
        "temperature",
    ],
    later: &[],
};

pub(super) static CURVE: Section = Section {
    name: "curve",
    keys: &["kind", "points", "file", "closed", "alpha", "scale", "about"],
    later: &[],
};

pub(super) static RADIUS: Section = Section {
    name: "radius",
    keys: &["kind", "mean", "amplitude", "waves", "phase", "from", "to", "power", "file"],
    later: &[],
};

/// A number that changes over time.
pub(super) static TRACK: Section = Section {
    name: "a number over time",
    keys: &["keys", "interpolation", "repeat", "mean", "amplitude", "period", "phase"],
    later: &[],
};

/// A point that moves in a circle.
pub(super) static ORBIT: Section =
    Section { name: "a moving point", keys: &["centre", "arm", "period", "axis"], later: &[] };

pub(super) static ENVELOPE: Section = Section { name: "envelope", keys: &["radial", "axial"], later: &[] };

pub(super) static REST: Section = Section { name: "rest", keys: &["radius", "length"], later: &[] };

pub(super) static LAYER: Section = Section {
    name: "[[tube.layer]]",
    keys: &[
        "op",
        "noise",
        "frequency",
        "octaves",
        "lacunarity",
        "gain",
        "normalise",
        "seed",
        "scroll",
        "form",
        "rotate",
        "warp",
        "space",
        "offset",
        "value",
        "threshold",
        "multiplier",
    ],
    later: &[],
};

pub(super) static WARP: Section = Section {
    name: "warp",
    keys: &["amplitude", "frequency", "octaves", "lacunarity", "gain", "seed"],
    later: &[],
};

pub(super) static MEDIUM: Section = Section {
    name: "[medium]",
    keys: &["extinction", "albedo", "anisotropy", "emission", "temperature"],
    later: &[],
};

pub(super) static CAMERA: Section = Section {
    name: "[camera]",
    keys: &["kind", "position", "look_at", "up", "fov", "width", "background", "exposure"],
    later: &[],
};

pub(super) static LIGHT: Section = Section {
    name: "[[light]]",
    keys: &["kind", "direction", "irradiance", "position", "intensity", "radiance"],
    later: &[],
};

/// All of them, in the order of a scene.
pub(super) static SECTIONS: [&Section; 15] = [
    &ROOT, &BAKE, &TIME, &TUBE, &CURVE, &ORBIT, &TRACK, &RADIUS, &ENVELOPE, &REST, &LAYER, &WARP, &MEDIUM,
    &CAMERA, &LIGHT,
];
