//! Times at the extremes, and numbers that move.

use super::{NOISE, quadratic};
use crate::check::case::{Case, Verdict, scene};
use crate::check::probe::{Probe, worst};

const GROUP: &str = "time";

pub(super) fn cases() -> Vec<Case> {
    let moving =
        "radius = 0.25\nspin = 0.37\n[[tube.layer]]\nop = \"add\"\noctaves = 3\nscroll = [0.1, 0.2, -0.3]";
    let orbiting = format!(
        "[[tube]]\ncurve = {{ points = [[0, 0, -1], {{ centre = [0, 0, 0], arm = [0.5, 0.2, 0], period = 0.001 }}, [0, 0, 1]] }}\nradius = 0.2\n{NOISE}\n"
    );
    let waves = format!(
        "[[tube]]\ncurve = {{ points = [[0, 0, -1], [0.4, 0, 0], [0, 0, 1]] }}\nradius = {{ mean = 0.2, amplitude = 0.1, period = 1e-9 }}\n{NOISE}\n"
    );
    let keys = format!(
        "[[tube]]\ncurve = {{ points = [[0, 0, -1], [0.4, 0, 0], [0, 0, 1]] }}\nradius = {{ keys = [[0, 0.1], [1e-9, 0.3], [1e9, 0.1]], interpolation = \"linear\" }}\n{NOISE}\n"
    );
    let mut cases = Vec::new();
    for seconds in [-1e9, -1.0, 1e9] {
        let texts = [
            ("spin and scroll", quadratic(&super::BENT, moving), 4e-6),
            ("points that circle a thousand times a second", orbiting.clone(), 4e-6),
            ("a radius that swings a billion times a second", waves.clone(), 4e-6),
            ("keys 1e-9 s and 1e9 s apart", keys.clone(), 4e-6),
        ];
        for (what, text, bound) in texts {
            cases.push(Case::new(
                GROUP,
                format!("{what}, {seconds:e} s"),
                "finite, and the definition within 4e-6 of the peak: phases are reduced in double precision",
                move || at(&text, seconds, bound),
            ));
        }
    }
    cases
}

/// The density at a time against the definition at that time.
fn at(text: &str, seconds: f64, bound: f64) -> Verdict {
    let found = scene(text).and_then(|scene| {
        let scene = scene.at(seconds).map_err(|errors| errors.to_string())?;
        let probe = Probe::new(scene, 0.02).map_err(|error| error.to_string())?;
        let deviation = probe.deviation(1000, 0.0)?;
        if deviation.peak <= 0.0 { Err("no density was found".to_owned()) } else { Ok(deviation) }
    });
    found.map_or_else(Verdict::failed, |deviation| {
        Verdict::at_most(bound, worst(deviation.largest, deviation.lost) / deviation.peak)
    })
}
