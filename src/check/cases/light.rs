//! Light: no extinction and all of it, thin and stiff, cameras inside and beside.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::{BENT, NOISE, STRAIGHT, quadratic};
use crate::check::case::{Case, Verdict, scene};
use crate::check::family::Miss;
use crate::check::probe::worst;
use crate::field::{Field, Lattice};
use crate::formats::vdb::{Compression, Encoder};
use crate::march::{
    Baked, Camera, Film, Grid, Integrator, Lamp, Meaning, Medium, Optics, Picture, Procedural, Quality,
    Sampling, Shadow, phase,
};
use crate::num::Level;
use crate::num::quadrature::gauss_legendre;
use crate::report::{Pilot, Trial, rows};

const GROUP: &str = "light";
/// Metres.
const H: f64 = 0.05;
/// Through the straight tube, along its axis, in metres.
const THICKNESS: f64 = 2.0;
const BUDGET: u64 = 1 << 30;
const PIXELS: usize = 4;
/// Voxels that rays may find of a scene beyond a hard end or surface: bounds hold a hundredth more than the tube, and rays are cut a
/// thousandth beside them; rounding, of 4e-6 radii, is the rest.
const GUARD: f64 = 0.0112;

pub(super) fn cases() -> Vec<Case> {
    let mut cases = vec![
        Case::new(GROUP, "no extinction", "transmittance 1 and radiance 0, to the bit", || {
            both(|medium| {
                let clear = scene("[medium]\nextinction = 0\n")
                    .map(|scene| Optics::new(&scene.medium(), scene.lights()));
                let Ok(optics) = clear else { return Verdict::failed("it is refused") };
                let film = shoot(medium, along_axis(), &optics);
                let is_clear = film.transmittance.iter().all(|t| t.to_bits() == 1.0_f64.to_bits());
                let is_dark = film.radiance.iter().flatten().all(|x| *x == 0.0);
                Verdict::is(
                    is_clear && is_dark,
                    format!("{} and {:?}", film.transmittance[0], film.radiance[0]),
                )
            })
        }),
        Case::new(
            GROUP,
            "a white furnace",
            "radiance and transmittance add up to 1 within 2e-6, by single precision",
            furnace,
        ),
        Case::new(
            GROUP,
            "an orthographic camera inside",
            "from there on, within 0.0112 voxels at the end",
            || {
                both(|medium| {
                    let film = shoot(medium, looking(DVec3::ZERO, DVec3::Z), &optics(1.0));
                    Verdict::at_most(GUARD * H, (film.depth[0] - 0.5 * THICKNESS).abs())
                })
            },
        ),
        Case::new(
            GROUP,
            "a perspective camera inside, far off the axis",
            "finite, and no less than 0",
            || {
                both(|medium| {
                    let camera = Camera {
                        is_orthographic: false,
                        half: DVec2::splat(100.0),
                        ..looking(DVec3::new(0.3, 0.2, 0.1), DVec3::Z)
                    };
                    finite(&shoot(medium, camera, &optics(1e3)))
                })
            },
        ),
        Case::new(
            GROUP,
            "a camera on the end plane, looking in",
            "all of the tube, within 0.0112 voxels at each end",
            || {
                // Voxels reach half a voxel beyond their centres, so only the scene itself ends at the plane.
                scene_alone(|medium| {
                    let film = shoot(medium, looking(DVec3::new(0.0, 0.0, 1.0), DVec3::NEG_Z), &optics(1.0));
                    Verdict::at_most(2.0 * GUARD * H, (film.depth[0] - THICKNESS).abs())
                })
            },
        ),
        Case::new(GROUP, "a camera on the end plane, looking away", "nothing beyond 0.0112 voxels", || {
            scene_alone(|medium| {
                let film = shoot(medium, looking(DVec3::new(0.0, 0.0, 1.0), DVec3::Z), &optics(1.0));
                Verdict::at_most(GUARD * H, film.depth[0])
            })
        }),
        Case::new(GROUP, "a direction with negative zeros", "the same as without, to the bit", || {
            both(|medium| {
                let [a, b] = [0.0, -0.0].map(|zero| {
                    shoot(
                        medium,
                        looking(DVec3::new(zero, zero, -4.0), DVec3::new(zero, zero, 1.0)),
                        &optics(1.0),
                    )
                    .depth
                });
                Verdict::is(a == b, format!("{} and {}", a[0], b[0]))
            })
        }),
        Case::new(GROUP, "a camera at 1e9 m", "finite, and no less than 0", || {
            both(|medium| {
                finite(&shoot(medium, looking(DVec3::new(0.0, 0.0, -1e9), DVec3::Z), &optics(10.0)))
            })
        }),
        Case::new(
            GROUP,
            "two points as far apart as a sheared grid has them",
            "optical depths along it within 1e-6",
            sheared,
        ),
        Case::new(
            GROUP,
            "noise in voxels and without, at every instruction set",
            "the same picture, to the bit",
            every_level,
        ),
        Case::new(GROUP, "a singular grid", "refused", || {
            let rows = [[1.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];
            Verdict::is(Grid::from_rows(&rows).is_none(), "no map")
        }),
    ];
    for x in [0.0, 0.5, 0.9, 1.0 - 1e-6, 1.0, 1.0 + 1e-12] {
        cases.push(Case::new(
            GROUP,
            format!("a ray across the tube at {x:?} radii"),
            "the chord of a tube that is thicker by 0.0112 voxels at most: what rays may find beyond a hard surface",
            move || scene_alone(|medium| chord(medium, x)),
        ));
    }
    for depth in [1e-12, 1e-6, 1e-3, 1.0, 1e4, 1e8, 1e30] {
        cases.push(Case::new(
            GROUP,
            format!("an optical depth of {depth:e} a step"),
            "light that comes through, and a glow 1 - e^-depth, within 1e-5 of closed forms; of the scene 6e-4, by 0.0112 voxels at each end",
            move || both(|medium| slab(medium, depth / H)),
        ));
    }
    for g in [-0.999, -0.99, 0.0, 0.9, 0.999, 1.0 - 1e-9] {
        cases.push(Case::new(
            GROUP,
            format!("the phase function of a mean cosine of {g:?}"),
            "an integral of 1 over the sphere, and its mean cosine, within 1e-10: quadrature on rings that halve towards the peak",
            move || phase_function(g),
        ));
    }
    for g in [-0.999, 0.0, 0.999] {
        cases.push(Case::new(
            GROUP,
            format!("a mean cosine of {g}, towards the sun"),
            "depth e^-depth times the phase function, within 1e-3 of it, by a hundredth of a voxel at each end",
            move || scene_alone(|medium| towards_the_sun(medium, g)),
        ));
    }
    cases
}

/// Only extinction.
fn optics(extinction: f64) -> Optics {
    Optics {
        extinction,
        is_clear: false,
        albedo: DVec3::ZERO,
        anisotropy: 0.0,
        emission: DVec3::ZERO,
        lamps: Vec::new(),
        ambient: DVec3::ZERO,
    }
}

fn looking(eye: DVec3, forward: DVec3) -> Camera {
    let right = forward.any_orthonormal_vector();
    let up = right.cross(forward);
    Camera { eye, forward, right, up, half: DVec2::splat(0.3), is_orthographic: true }
}

fn along_axis() -> Camera {
    looking(DVec3::new(0.0, 0.0, -4.0), DVec3::Z)
}

fn shoot(medium: &Medium<'_>, camera: Camera, optics: &Optics) -> Film {
    shoot_at(medium, camera, optics, Integrator::Single, Level::best())
}

fn shoot_at(
    medium: &Medium<'_>,
    camera: Camera,
    optics: &Optics,
    integrator: Integrator,
    level: Level,
) -> Film {
    let quality = Quality { size: [PIXELS; 2], samples: 1, cutoff: 0.0, shadow: Shadow::Exact, integrator };
    let mut picture = Picture::new(medium, camera, optics, quality, level);
    picture.sample(|_| true);
    picture.film().clone()
}

/// A straight tube of density 1 along z.
fn solid() -> String {
    quadratic(&STRAIGHT, "radius = 1\ncaps = \"flat\"\nenvelope = { radial = \"hard\" }")
}

/// What is true of the straight tube itself.
fn scene_alone(check: impl Fn(&Medium<'_>) -> Verdict) -> Verdict {
    let found = scene(&solid()).and_then(|scene| {
        let field = Field::compile(&scene);
        let medium = Procedural::new(&field, Lattice { voxel_size: H }, 1.0, BUDGET);
        let medium = Medium::Procedural(medium.map_err(|error| error.to_string())?);
        Ok(check(&medium))
    });
    found.unwrap_or_else(Verdict::failed)
}

/// What is true of it, and of its voxels.
fn both(check: impl Fn(&Medium<'_>) -> Verdict) -> Verdict {
    let voxels = voxels(&solid()).and_then(|trial| {
        let grid = Grid::from_rows(&rows(Lattice { voxel_size: H })).ok_or("no map")?;
        let baked =
            Baked::new(&trial.tree, grid, Meaning::Density, BUDGET).map_err(|error| error.to_string())?;
        Ok(check(&Medium::Baked(baked)))
    });
    let voxels = voxels.unwrap_or_else(Verdict::failed).of("voxels");
    Verdict::all([scene_alone(check).of("the scene"), voxels])
}

fn voxels(text: &str) -> Result<Trial, String> {
    let scene = scene(text)?;
    let lot = Pilot::new(&scene, BUDGET).at(Lattice { voxel_size: H }).map_err(|error| error.to_string())?;
    Trial::new(&lot.field, &lot.plan, 0.0, Encoder::new(Compression::None)).map_err(|error| error.to_string())
}

fn slab(medium: &Medium<'_>, extinction: f64) -> Verdict {
    let glowing = Optics { emission: DVec3::splat(extinction), ..optics(extinction) };
    let film = shoot(medium, along_axis(), &glowing);
    let depth = extinction * THICKNESS;
    let glow = -libm::expm1(-depth);
    let through = (film.transmittance[0] - libm::exp(-depth)).abs();
    let off = (film.radiance[0][0] - glow).abs() / glow;
    let ends = if matches!(medium, Medium::Procedural(_)) { 2.0 * GUARD * H / THICKNESS } else { 0.0 };
    Verdict::all([Verdict::at_most(1e-5 + ends, through), Verdict::at_most(1e-5 + ends, off)])
}

/// What is off where a step has this optical depth: of the light that comes through, and of a glow over itself; in the tube itself
/// and in its voxels, whichever is more.
pub(in crate::check) fn stiffness(depth: f64) -> Result<f64, Miss> {
    let verdict = both(|medium| slab(medium, depth / H));
    verdict.error().ok_or_else(|| Miss::Failed(verdict.found().to_owned()))
}

/// Noise in a furnace of radiance 1 that absorbs nothing.
fn furnace() -> Verdict {
    let text = quadratic(&BENT, &format!("radius = 0.4\n{NOISE}"));
    let found = scene(&text).and_then(|scene| {
        let field = Field::compile(&scene);
        let medium = Procedural::new(&field, Lattice { voxel_size: H }, 1.0, BUDGET);
        let medium = Medium::Procedural(medium.map_err(|error| error.to_string())?);
        let white = |extinction| Optics { albedo: DVec3::ONE, ambient: DVec3::ONE, ..optics(extinction) };
        let mut most = 0.0_f64;
        for extinction in [1e-6, 1.0, 1e3, 1e9] {
            let film = shoot(&medium, looking(DVec3::new(-4.0, 0.1, 0.1), DVec3::X), &white(extinction));
            for (radiance, through) in film.radiance.iter().zip(&film.transmittance) {
                for colour in radiance {
                    most = worst(most, (colour + through - 1.0).abs());
                }
            }
        }
        Ok(most)
    });
    found.map_or_else(Verdict::failed, |error| Verdict::at_most(2e-6, error))
}

/// A sun that shines at the camera through the tube.
fn towards_the_sun(medium: &Medium<'_>, g: f64) -> Verdict {
    let sun = Lamp::Sun { direction: DVec3::NEG_Z, irradiance: DVec3::ONE };
    let optics = Optics { albedo: DVec3::ONE, anisotropy: g, lamps: vec![sun], ..optics(0.4) };
    let film = shoot(medium, along_axis(), &optics);
    let depth = 0.4 * THICKNESS;
    let phase = (1.0 + g) / (4.0 * PI * (1.0 - g) * (1.0 - g));
    let expected = phase * depth * libm::exp(-depth);
    Verdict::at_most(1e-3, (film.radiance[0][0] - expected).abs() / expected)
}

/// The function over the whole sphere.
fn phase_function(g: f64) -> Verdict {
    let nodes = gauss_legendre(16);
    let (mut sum, mut mean) = (0.0, 0.0);
    // In y = 1 - |cos| from the peak's side, in rings from 2 down to 2^-110; what is left holds no more than 2^-110 / (1 - g)^2.
    let peak = if g < 0.0 { DVec3::NEG_Z } else { DVec3::Z };
    for ring in 0..111 {
        let outer = 2.0 * libm::exp2(-f64::from(ring));
        for [x, weight] in &nodes {
            let y = 0.5 * outer * (1.0 + x);
            let to = peak * (1.0 - y) + DVec3::X * (y * (2.0 - y)).sqrt();
            let part = 2.0 * PI * phase(g, DVec3::Z, to) * 0.5 * outer * weight;
            sum += part;
            mean += part * to.z;
        }
    }
    let [whole, cosine] =
        [Verdict::at_most(1e-10, (sum - 1.0).abs()), Verdict::at_most(1e-10, (mean - g).abs())];
    Verdict::all([whole.of("the integral"), cosine.of("the mean cosine")])
}

/// Pictures by the lanes of every level that the processor has.
fn every_level() -> Verdict {
    let text = quadratic(&BENT, &format!("radius = 0.4\n{NOISE}"));
    let found = scene(&text).and_then(|scene| {
        let field = Field::compile(&scene);
        let procedural = Procedural::new(&field, Lattice { voxel_size: H }, 1.0, BUDGET);
        let procedural = Medium::Procedural(procedural.map_err(|error| error.to_string())?);
        let trial = voxels(&text)?;
        let grid = Grid::from_rows(&rows(Lattice { voxel_size: H })).ok_or("no map")?;
        let baked =
            Baked::new(&trial.tree, grid, Meaning::Density, BUDGET).map_err(|error| error.to_string())?;
        let sun = Lamp::Sun { direction: DVec3::NEG_Z, irradiance: DVec3::ONE };
        let mut pictures = 0;
        let planes = Medium::Baked(baked.clone().with(Sampling::Planes));
        for medium in [&procedural, &Medium::Baked(baked), &planes] {
            for extinction in [1e-3, 5.0, 1e6] {
                for integrator in [Integrator::Single, Integrator::Path { seed: 1 }] {
                    let optics = Optics { albedo: DVec3::splat(0.8), lamps: vec![sun], ..optics(extinction) };
                    let camera = looking(DVec3::new(-4.0, 0.1, 0.1), DVec3::X);
                    let film = |level| shoot_at(medium, camera, &optics, integrator, level);
                    let best = film(Level::best());
                    for level in Level::all() {
                        let bits = |film: &Film| {
                            let values = film.depth.iter().chain(&film.transmittance);
                            let values = values.chain(film.radiance.iter().flatten());
                            values.map(|x| x.to_bits()).collect::<Vec<_>>()
                        };
                        if bits(&film(level)) != bits(&best) {
                            return Err(format!(
                                "{} and {} draw other bits",
                                level.name(),
                                Level::best().name()
                            ));
                        }
                        pictures += 1;
                    }
                }
            }
        }
        Ok(Verdict::is(pictures > 0, format!("{pictures} pictures are alike")))
    });
    found.unwrap_or_else(Verdict::failed)
}

fn chord(medium: &Medium<'_>, x: f64) -> Verdict {
    let camera = Camera { half: DVec2::splat(1e-13), ..looking(DVec3::new(x, -4.0, 0.03), DVec3::Y) };
    let film = shoot(medium, camera, &optics(1.0));
    let chord = |radius: f64| 2.0 * (radius * radius - x * x).max(0.0).sqrt();
    let thicker = 1.0 + GUARD * H;
    Verdict::at_most(chord(thicker) - chord(1.0) + 1e-6, (film.depth[0] - chord(1.0)).abs())
}

fn finite(film: &Film) -> Verdict {
    let values = film.depth.iter().chain(&film.transmittance).chain(film.radiance.iter().flatten());
    let is_fine = values.clone().all(|x| x.is_finite() && *x >= 0.0);
    Verdict::is(is_fine, if is_fine { "finite" } else { "a value that is none" })
}

/// Voxels whose cells are boxes leaning to one side.
fn sheared() -> Verdict {
    let found = voxels(&solid()).and_then(|trial| {
        let rows = [[0.1, 0.0, 0.03, 0.0], [0.0, 0.02, 0.01, 0.0], [0.0, 0.0, 0.2, 0.1]];
        let grid = Grid::from_rows(&rows).ok_or("no map")?;
        let axis = [-40.0, 40.0].map(|z| grid.to_world(DVec3::new(-0.5, -0.5, z)));
        let baked =
            Baked::new(&trial.tree, grid, Meaning::Density, BUDGET).map_err(|error| error.to_string())?;
        let medium = Medium::Baked(baked);
        let ray = crate::march::Ray { origin: axis[0], direction: (axis[1] - axis[0]).normalize() };
        // 40 voxels of density 1 along the grid's own z.
        let expected = 40.0 * DVec3::new(0.03, 0.01, 0.2).length();
        let found = medium.optical_depth(&ray, [0.0, f64::INFINITY], 1.0, Level::best());
        Ok((found - expected).abs() / expected)
    });
    found.map_or_else(Verdict::failed, |error| Verdict::at_most(1e-6, error))
}
