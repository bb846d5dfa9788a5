//! The scripts that show a baked file in other renderers: what comes through their pictures of three scenes beside `vdbake
//! render`, and what they make of a small tube beside integrals of its voxels along the rays of the same camera.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use exr::prelude::{FlatSamples, read_first_flat_layer_from_file};
use glam::{DVec2, DVec3};
use rayon::prelude::*;
use serde_json::Value;
use tempfile::{TempDir, tempdir};
use vdbake::field::Field;
use vdbake::formats::vdb::{AnyTree, Tree, VdbFile};
use vdbake::march::{Camera, Ray};
use vdbake::scene::{Light, Scene};
use vdbake::volume::{Filter, Sampler, WorldToIndex};

use crate::oracle::judge;
use crate::support::{stderr, stdout, vdbake, write};

/// A bent tube with lumps. Its voxels are coarse, so that half of one is seen.
const TUBE: &str = r#"
[bake]
voxel_size = 0.08
[[tube]]
curve = { points = [[-0.8, 0.1, -0.4], [0.1, 0, 0.5], [0.8, -0.1, -0.2]] }
radius = [[0, 0.3], [1, 0.45]]
caps = "round"
[[tube.layer]]
noise = "constant"
value = 0.6
[[tube.layer]]
op = "add"
octaves = 2
multiplier = 0.7
threshold = 0.0
"#;

/// Light from one side, in colours of its own, on a medium that scatters forwards.
const LIT: &str = r#"
[medium]
extinction = 2.0
albedo = [0.9, 0.7, 0.5]
anisotropy = 0.4
[camera]
kind = "orthographic"
[[light]]
direction = [-1.0, 0.6, -0.8]
irradiance = [3.0, 2.0, 1.0]
"#;

/// A baked scene, and what is needed to follow rays through its voxels.
struct Case {
    folder: TempDir,
    scene: Scene,
    vdb: PathBuf,
    toml: PathBuf,
    tree: Tree<f32>,
    map: WorldToIndex,
    /// Corners in metres of a box around all that is not 0.
    bounds: [DVec3; 2],
    /// Metres.
    voxel_size: f64,
    size: [u32; 2],
}

impl Case {
    fn new(text: &str, size: [u32; 2]) -> Case {
        Case::baked(text, size, &[])
    }

    /// A scene that comes with the project, with so many voxels along its longest side.
    fn shipped(name: &str, resolution: &str, size: [u32; 2]) -> Case {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).with_extension("toml");
        let text = fs::read_to_string(path).expect("a readable scene");
        Case::baked(&text, size, &["--resolution", resolution])
    }

    fn baked(text: &str, size: [u32; 2], options: &[&str]) -> Case {
        let folder = tempdir().expect("a folder");
        let toml = write(&folder.path().join("case.toml"), text);
        let vdb = folder.path().join("case.vdb");
        let output =
            vdbake().arg("bake").arg(&toml).arg("--quiet").arg("-o").arg(&vdb).args(options).output();
        let output = output.expect("the program starts");
        assert!(output.status.success(), "{}", stderr(&output));
        let mut file = VdbFile::open(File::open(&vdb).expect("a file")).expect("a VDB file");
        let grid = file.grid("density").expect("a grid");
        let AnyTree::Float(tree) = grid.tree else { panic!("not of floats") };
        let rows = grid.info.map.matrix.expect("an affine map");
        let [low, high] = tree.stats().bounds.expect("active voxels");
        let world = |index: [i32; 3], by: f64| {
            DVec3::from([0, 1, 2].map(|i| rows[i][i] * (f64::from(index[i]) + by) + rows[i][3]))
        };
        Case {
            scene: Scene::parse(text, "case").expect("valid"),
            vdb,
            toml,
            map: WorldToIndex::new(&rows).expect("an invertible map"),
            // Half of a voxel more, for grids that are shifted.
            bounds: [world(low, -1.5), world(high, 1.5)],
            tree,
            voxel_size: rows[0][0],
            size,
            folder,
        }
    }

    fn camera(&self) -> Camera {
        let [width, height] = self.size.map(f64::from);
        Camera::new(&self.scene.camera(), Field::compile(&self.scene).bounds(), width / height)
    }

    /// Points on a ray this far apart at most, in metres, with their distance.
    fn steps(&self, ray: Ray, step: f64) -> (impl Iterator<Item = DVec3> + use<>, f64) {
        let inverse = ray.direction.recip();
        let faces = self.bounds.map(|corner| (corner - ray.origin) * inverse);
        let from = faces[0].min(faces[1]).max_element().max(0.0);
        let to = faces[0].max(faces[1]).min_element();
        let count = ((to - from) / step).ceil().max(0.0);
        let step = if count > 0.0 { (to - from) / count } else { 0.0 };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small count")]
        let count = count as u32;
        ((0..count).map(move |n| ray.at(from + (f64::from(n) + 0.5) * step)), step)
    }

    /// The integral of the trilinear voxels along a ray, when the grid is shifted by so many voxels along all axes. The sum of
    /// four midpoints a voxel is within 1e-4 of it here.
    fn depth(&self, sampler: &mut Sampler<'_, f32>, ray: Ray, step: f64, shift: f64) -> f64 {
        let (points, step) = self.steps(ray, step * self.voxel_size);
        let sum: f64 = points.map(|point| sampler.sample(self.map.index(point) - shift)).sum();
        sum * step * self.scene.medium().extinction
    }

    /// The mean of a function of rays over every pixel, in rows from the top.
    fn pixels(&self, of: impl Fn(&mut Sampler<'_, f32>, Ray) -> f64 + Sync) -> Vec<f64> {
        /// Rays along either side of a pixel.
        const RAYS: u32 = 4;
        let camera = self.camera();
        let [width, height] = self.size;
        let pixel = |pixel: u32| {
            let mut sampler = Sampler::new(&self.tree, Filter::Trilinear);
            let corner = DVec2::new(f64::from(pixel % width), f64::from(pixel / width));
            let rays = (0..RAYS * RAYS).map(|ray| {
                let within = DVec2::new(f64::from(ray % RAYS), f64::from(ray / RAYS)) + 0.5;
                let place = (corner + within / f64::from(RAYS)) / self.size_as_vector();
                camera.ray(DVec2::new(2.0 * place.x - 1.0, 1.0 - 2.0 * place.y))
            });
            rays.map(|ray| of(&mut sampler, ray)).sum::<f64>() / f64::from(RAYS * RAYS)
        };
        (0..width * height).into_par_iter().map(pixel).collect()
    }

    fn size_as_vector(&self) -> DVec2 {
        DVec2::from(self.size.map(f64::from))
    }

    /// The part of light that comes through by `vdbake render`, when the grid is shifted by so many voxels along all axes: when
    /// the camera is, the other way.
    fn transmittance(&self, shift: f64) -> Vec<f64> {
        let [width, height] = self.size;
        let size = format!("{width}x{height}");
        let from = &view(&[self.vdb.to_str().expect("a plain path"), "--size", &size])["camera"];
        let vector = |key: &str| -> DVec3 {
            serde_json::from_value(from[key].clone()).map(DVec3::from_array).expect("a vector")
        };
        assert_eq!(from["is_orthographic"], false);
        let eye = vector("eye") - shift * self.voxel_size;
        let fov = 2.0 * libm::atan(from["half"][0].as_f64().expect("a number")).to_degrees();
        let extinction = self.scene.medium().extinction;
        let shifted = write(
            &self.folder.path().join("shifted.toml"),
            &format!(
                "[medium]\nextinction = {extinction:?}\n[camera]\nposition = {:?}\nlook_at = {:?}\nup = {:?}\nfov = {fov:?}\n",
                eye.to_array(),
                (eye + vector("forward")).to_array(),
                vector("up").to_array()
            ),
        );
        let image = self.folder.path().join("own.exr");
        let mut command = vdbake();
        command.arg("render").arg(&self.vdb).arg("-o").arg(&image).args(["--size", &size, "--quiet"]);
        // So many that a pixel's mean has less of an error than the others' noise; light is followed to where next to none is left.
        command.args(["--absorption-only", "--samples", "256", "--cutoff", "1e-9"]);
        if shift != 0.0 {
            command.arg("--scene").arg(shifted);
        }
        let output = command.output().expect("the program starts");
        assert!(output.status.success(), "{}", stderr(&output));
        channel(&image, "transmittance.Y", self.size)
    }

    /// Radiance of light that was scattered once, of a sun of irradiance 1 in a medium of albedo 1.
    fn scattered(&self) -> Vec<f64> {
        let Light::Sun { direction, .. } = self.scene.lights()[0] else { panic!("no sun") };
        let (medium, direction) = (self.scene.medium(), DVec3::from(direction));
        let g = medium.anisotropy;
        self.pixels(|sampler, ray| {
            // Henyey and Greenstein's function of the angle between the ways that light comes and goes.
            let cosine = -direction.dot(ray.direction);
            let phase =
                (1.0 - g * g) / (4.0 * std::f64::consts::PI * libm::pow(1.0 + g * g - 2.0 * g * cosine, 1.5));
            let (points, step) = self.steps(ray, 0.5 * self.voxel_size);
            let (mut radiance, mut depth) = (0.0, 0.0);
            for point in points {
                let here = medium.extinction * sampler.sample(self.map.index(point)) * step;
                if here > 0.0 {
                    let sun = self.depth(sampler, Ray { origin: point, direction: -direction }, 0.5, 0.0);
                    radiance += here * phase * libm::exp(-(depth + 0.5 * here) - sun);
                }
                depth += here;
            }
            radiance
        })
    }

    /// Runs a script on `file` with the sizes of this picture; gives its red, green and blue.
    fn render(&self, script: &str, file: &Path, arguments: &[&str]) -> [Vec<f64>; 3] {
        let out = self.folder.path().join("out.exr");
        self.run(script, file, &[&["-o", out.to_str().expect("a plain path")], arguments].concat());
        channels(&out, self.size)
    }

    fn run(&self, script: &str, file: &Path, arguments: &[&str]) {
        let [width, height] = self.size;
        let python = if script == MITSUBA { "VDBAKE_MITSUBA_PYTHON" } else { "VDBAKE_BPY_PYTHON" };
        let mut command: Command = judge(python);
        command
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts").join(script))
            .arg(file)
            .args(["--vdbake", env!("CARGO_BIN_EXE_vdbake"), "--size", &format!("{width}x{height}")])
            .args(arguments);
        let output = command.output().expect("the script starts");
        assert!(output.status.success(), "{command:?}: {}", stderr(&output));
    }

    /// The file that Mitsuba takes.
    fn vol(&self) -> PathBuf {
        let vol = self.folder.path().join("case.vol");
        let output =
            vdbake().arg("convert").arg(&self.vdb).arg(&vol).arg("--quiet").output().expect("it starts");
        assert!(output.status.success(), "{}", stderr(&output));
        vol
    }
}

const BLENDER: &str = "blender_load.py";
const MITSUBA: &str = "mitsuba_render.py";

/// Red, green and blue of an image.
fn channels(path: &Path, size: [u32; 2]) -> [Vec<f64>; 3] {
    ["R", "G", "B"].map(|name| channel(path, name, size))
}

/// A channel of an image, in rows from the top.
fn channel(path: &Path, name: &str, size: [u32; 2]) -> Vec<f64> {
    let image = read_first_flat_layer_from_file(path).expect("an image");
    let mut channels = image.layer_data.channel_data.list.iter();
    let channel = channels.find(|channel| channel.name.eq(name)).expect("a channel");
    assert!(matches!(channel.sample_data, FlatSamples::F32(_)));
    let values: Vec<f64> = channel.sample_data.values_as_f32().map(f64::from).collect();
    assert_eq!(values.len(), size.map(|side| side as usize).iter().product::<usize>());
    values
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

/// How far the mean of two pictures is from what is expected, where that is dark enough to tell anything.
#[derive(Debug)]
struct Distance {
    mean: f64,
    root_mean_square: f64,
    /// Root mean square that the mean of the two has by chance alone.
    noise: f64,
    pixels: usize,
}

impl Distance {
    fn new(found: [&[f64]; 2], expected: &[f64]) -> Distance {
        let shown: Vec<usize> = (0..expected.len()).filter(|i| expected[*i] < libm::exp(-0.05)).collect();
        let off = |i: &usize| 0.5 * (found[0][*i] + found[1][*i]) - expected[*i];
        let chance = |i: &usize| 0.5 * (found[0][*i] - found[1][*i]);
        let root = |of: &dyn Fn(&usize) -> f64| mean(shown.iter().map(|i| of(i) * of(i))).sqrt();
        Distance {
            mean: mean(shown.iter().map(off)),
            root_mean_square: root(&off),
            noise: root(&chance),
            pixels: shown.len(),
        }
    }

    /// Whether the two are one picture but for chance, which moves the mean by half of this or less.
    fn is_chance(&self) -> bool {
        self.mean.abs() < 5e-4 && self.root_mean_square < 1.2 * self.noise
    }
}

/// That what comes through the voxels by a script is what comes through them by `vdbake render`; of a grid shifted by half a
/// voxel it is not.
fn assert_transmittance(name: &str, case: &Case, script: &str, file: &Path, arguments: &[&str]) {
    let [first, second] = ["1", "2"].map(|seed| {
        let [red, green, blue] =
            case.render(script, file, &[&["--absorption-only", "--seed", seed], arguments].concat());
        // Without colour; renderers round it in their own ways.
        assert!(red.iter().zip(&green).zip(&blue).all(|((r, g), b)| (r - g).abs() + (r - b).abs() < 1e-5));
        red
    });
    let found = [&first[..], &second[..]];
    let right = Distance::new(found, &case.transmittance(0.0));
    let shifted = Distance::new(found, &case.transmittance(0.5));
    assert!(right.pixels > 500, "{name}: {right:?}");
    assert!(right.is_chance(), "{name}: {right:?}");
    assert!(!shifted.is_chance(), "{name}: {shifted:?}");
}

/// A scene as it is shown to both.
struct Shown {
    name: &'static str,
    /// Voxels along its longest side: as few as its noise allows, so that half of one is seen.
    resolution: &'static str,
    /// Of Mitsuba, which lets all or nothing of a ray through: so many that the mean is good to 3e-4 by the spread of its pixels.
    samples: &'static str,
}

const SCENES: [Shown; 3] = [
    Shown { name: "tornado", resolution: "40", samples: "512" },
    Shown { name: "solar_flare", resolution: "96", samples: "384" },
    Shown { name: "galaxy", resolution: "64", samples: "768" },
];

#[test]
fn light_comes_through_in_blender_as_in_ours() {
    for Shown { name, resolution, .. } in SCENES {
        let case = Case::shipped(name, resolution, [120, 68]);
        // The scene is the one in the file. Blender's mean is off by a part of a step: by 3e-4 in the densest of these.
        let arguments = ["--samples", "16", "--step", "0.0125"];
        assert_transmittance(name, &case, BLENDER, &case.vdb, &arguments);
    }
}

#[test]
fn light_comes_through_in_mitsuba_as_in_ours() {
    for Shown { name, resolution, samples, .. } in SCENES {
        let case = Case::shipped(name, resolution, [120, 68]);
        let scene = case.toml.to_str().expect("a plain path");
        assert_transmittance(name, &case, MITSUBA, &case.vol(), &["--scene", scene, "--samples", samples]);
    }
}

/// Albedo, phase function, irradiance, the sun's direction and an orthographic camera mean the same everywhere.
#[test]
fn light_is_scattered_once_in_both_as_the_formula_says() {
    let case = Case::new(&[TUBE, LIT].concat(), [64, 36]);
    let expected = case.scattered();
    let scene = case.toml.to_str().expect("a plain path");
    let blender = case.render(BLENDER, &case.vdb, &["--max-depth", "2", "--samples", "64"]);
    let mitsuba =
        case.render(MITSUBA, &case.vol(), &["--scene", scene, "--max-depth", "2", "--samples", "128"]);
    let factors = [3.0 * 0.9, 2.0 * 0.7, 1.0 * 0.5];
    for (name, found) in [("blender", blender), ("mitsuba", mitsuba)] {
        for (channel, factor) in found.iter().zip(factors) {
            let whole = mean(expected.iter().copied()) * factor;
            let ratio = mean(channel.iter().copied()) / whole;
            assert!((ratio - 1.0).abs() < 0.01, "{name}: {ratio}");
            // Pixels are noisy, but nearer to their own expectation than to that of the picture turned about.
            let off = |expected: &mut dyn Iterator<Item = &f64>| {
                mean(channel.iter().zip(expected).map(|(f, e)| (f - e * factor).abs())) / whole
            };
            let upright = off(&mut expected.iter());
            let rows = || expected.chunks_exact(case.size[0] as usize);
            let others = [
                off(&mut expected.iter().rev()),
                off(&mut rows().rev().flatten()),
                off(&mut rows().flat_map(|row| row.iter().rev())),
            ];
            assert!(
                upright < 0.15 && others.iter().all(|other| *other > 0.3),
                "{name}: {upright}, {others:?}"
            );
        }
    }
}

#[test]
fn scripts_make_pictures_for_the_eye_and_files_for_blender() {
    let case = Case::new(&[TUBE, LIT].concat(), [16, 9]);
    let in_folder = |name: &str| case.folder.path().join(name);
    let [blend, first, second] = ["case.blend", "first.png", "second.png"]
        .map(|name| in_folder(name).to_str().expect("plain").to_owned());
    case.run(BLENDER, &case.vdb, &["--samples", "1", "--save", &blend, "-o", &first]);
    let scene = case.toml.to_str().expect("a plain path");
    case.run(MITSUBA, &case.vol(), &["--scene", scene, "--samples", "1", "-o", &second]);
    for picture in [&first, &second] {
        assert!(fs::read(picture).expect("a picture").starts_with(b"\x89PNG"), "{picture}");
    }
    assert!(fs::metadata(&blend).is_ok_and(|file| file.len() > 1000));
}

fn view(arguments: &[&str]) -> Value {
    let output = vdbake().arg("info").args(arguments).arg("--json").output().expect("it starts");
    assert!(output.status.success(), "{}", stderr(&output));
    let report: Value = serde_json::from_str(&stdout(&output)).expect("one JSON object");
    report["view"].clone()
}

#[test]
fn a_view_is_the_camera_that_we_march_from() {
    let case = Case::new(&[TUBE, LIT].concat(), [160, 90]);
    let [toml, vdb] = [&case.toml, &case.vdb].map(|path| path.to_str().expect("a plain path"));
    let of_scene = view(&[toml, "--size", "160x90"]);
    let camera = case.camera();
    for (key, vector) in
        [("eye", camera.eye), ("forward", camera.forward), ("right", camera.right), ("up", camera.up)]
    {
        assert_eq!(of_scene["camera"][key], serde_json::json!(vector.to_array()), "{key}");
    }
    assert_eq!(of_scene["camera"]["half"], serde_json::json!(camera.half.to_array()));
    assert_eq!(of_scene["camera"]["is_orthographic"], true);
    assert_eq!(of_scene["lights"][0]["irradiance"], serde_json::json!([3.0, 2.0, 1.0]));
    // A baked file carries the same scene.
    assert_eq!(view(&[vdb, "--size", "160x90"]), of_scene);
    assert_eq!(view(&[toml])["size"], serde_json::json!([960, 540]));
}
