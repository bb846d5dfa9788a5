//! Radii: none, tiny, huge, jumping, steep.

use super::{BENT, NOISE, STRAIGHT, quadratic};
use crate::check::case::{Case, Look, Verdict, evaluates, probe, refuses, scene};
use crate::field::{Field, Lattice};
use crate::num::Level;
use crate::volume::{Plan, Store, bake};

const GROUP: &str = "radii";

pub(super) fn cases() -> Vec<Case> {
    let case = |name: &str, expected: &str, text: String, look: Look| {
        Case::new(GROUP, name, expected, move || evaluates(&text, look))
    };
    let with = |radius: &str| format!("radius = {radius}\n{NOISE}");
    let mut cases = vec![
        Case::new(GROUP, "a radius of 0", "refused: there would be no tube", || {
            refuses(&quadratic(&BENT, "radius = 0"), "above 0")
        }),
        Case::new(GROUP, "keys of radius 0 only", "refused: there would be no tube", || {
            refuses(&quadratic(&BENT, "radius = [[0, 0], [1, 0]]"), "radius")
        }),
        Case::new(GROUP, "a negative key", "refused", || {
            refuses(&quadratic(&BENT, "radius = [[0, 0.1], [1, -0.1]]"), "at least 0")
        }),
        Case::new(GROUP, "keys that rise and fall", "never below 0 between them: no overshoot", || {
            let text = quadratic(&BENT, "radius = [[0, 0.2], [0.49, 0], [0.51, 0], [1, 0.2]]");
            scene(&text).map_or_else(Verdict::failed, |scene| {
                let radius = &scene.tubes()[0].radius;
                let least = (0..=10_000).map(|n| radius.at(f64::from(n) / 1e4)).fold(f64::INFINITY, f64::min);
                Verdict::is(least >= 0.0, format!("{least:e} m at least"))
            })
        }),
        case(
            "a radius that touches 0",
            "the definition within 1e-5 of the peak; none where it is below 1e-6 of the largest",
            quadratic(&BENT, &with("[[0, 0.2], [0.5, 0], [1, 0.2]]")),
            Look::at(0.02).within(1e-5),
        ),
        Case::new(GROUP, "a radius of 1e-3 voxels, widened", "its mass within 5 %", || thin(true)),
        Case::new(
            GROUP,
            "a radius of 1e-3 voxels, not widened",
            "finite; what is between voxels is lost",
            || thin(false),
        ),
        case(
            "a radius of 1e6 times the length, round ends",
            "a ball's density within 4e-6 of the peak",
            quadratic(&[[0.0, 0.0, -1.0], [0.0; 3], [0.0, 0.0, 1.0]], "radius = 2e6\ncaps = \"round\""),
            Look::at(1e5),
        ),
        Case::new(GROUP, "that at voxels of 1 m", "refused before memory is taken", || {
            let text =
                quadratic(&[[0.0, 0.0, -1.0], [0.0; 3], [0.0, 0.0, 1.0]], "radius = 2e6\ncaps = \"round\"");
            Verdict::refused(probe(&text, 1.0), "too many")
        }),
        case(
            "a step of the radius",
            "the definition within 1e-5 of the peak beside the step, and bounds that hold it",
            quadratic(&BENT, &with("[[0, 0.1], [0.5, 0.1], [0.5, 0.3], [1, 0.3]]")),
            Look::at(0.02).within(1e-5).beside_jumps(1e-3),
        ),
        case(
            "a thousand beads",
            "the definition within 1e-3 of the peak: the slope of the radius over it is 3000 a length",
            quadratic(
                &STRAIGHT,
                &with("{ kind = \"sinusoidal\", mean = 0.1, amplitude = 0.05, waves = 1000 }"),
            ),
            Look { voxels: 400, ..Look::at(0.005).within(1e-3) },
        ),
    ];
    for slope in [1.0, 10.0, 100.0] {
        let length = 0.4 / slope;
        let points = [[0.0, 0.0, -0.5 * length], [0.0; 3], [0.0, 0.0, 0.5 * length]];
        cases.push(case(
            &format!("a radius that grows by {slope} m a metre"),
            "the definition within 1e-5 of the peak, and no density outside of the planned bricks",
            quadratic(&points, "radius = [[0, 0.01], [1, 0.41]]\ncaps = \"flat\""),
            Look::at(f64::min(0.02, 0.125 * length)).within(1e-5).beside_jumps(1e-3),
        ));
    }
    cases
}

/// A tube far thinner than a voxel.
fn thin(widen: bool) -> Verdict {
    let text = format!("[bake]\nwiden = {widen}\n{}", quadratic(&BENT, "radius = 2e-5"));
    let found = scene(&text).and_then(|scene| {
        let lattice = Lattice { voxel_size: 0.02 };
        let mut field = Field::compile(&scene);
        field.widen(lattice);
        let plan = Plan::new(&field, lattice, 1 << 30).map_err(|error| error.to_string())?;
        let mut store = Store::default();
        let Ok((tally, _)) = bake(&field, &plan, 0.0, Level::best(), &mut store, |_| ());
        let rest = crate::volume::RestMass::new(&field, &scene, lattice, 1 << 16, Level::best());
        let h = lattice.voxel_size;
        let mass = tally.total.sum() * (h * h * h);
        Ok((mass / rest.rest - 1.0).abs())
    });
    match found {
        Ok(error) if widen => Verdict::at_most(0.05, error),
        Ok(error) => Verdict::is(error.is_finite(), format!("mass off by {:.0} %", 100.0 * error)),
        Err(error) => Verdict::failed(error),
    }
}
