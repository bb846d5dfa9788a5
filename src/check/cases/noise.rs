//! Noise and what shapes it: octaves, gains, frequencies, twist.

use super::{BENT, STRAIGHT, of_kind, quadratic};
use crate::check::case::{Case, Look, PLAIN, Verdict, evaluates, probe, refuses};
use crate::num::Level;
use crate::volume::{Store, bake};

const GROUP: &str = "noise";

pub(super) fn cases() -> Vec<Case> {
    let case = |name: &str, expected: &str, text: String, look: Look| {
        Case::new(GROUP, name, expected, move || evaluates(&text, look))
    };
    let layer =
        |rest: &str| quadratic(&BENT, &format!("radius = 0.25\n[[tube.layer]]\nop = \"add\"\n{rest}"));
    let mut cases = vec![
        case(
            "no octave",
            "the envelope alone, within 4e-6 of the peak",
            layer("octaves = 0"),
            Look::at(0.02),
        ),
        case(
            "24 octaves",
            "the definition within 4e-6 of the peak: the upper ones fade",
            layer("octaves = 24"),
            Look::at(0.02),
        ),
        Case::new(GROUP, "24 octaves, and as many as do not fade", "the same values to the bit", faded),
        Case::new(GROUP, "33 octaves", "refused", || {
            refuses(
                "[[tube]]\ncurve = { points = [[0,0,0],[1,0,0],[2,0,0]] }\n[[tube.layer]]\noctaves = 33\n",
                "32",
            )
        }),
        case(
            "a gain of 1 over 8 octaves, unfaded",
            "the definition within 2e-4 of the peak: places to 5e-7, times slopes of 3.75 x 3 x 2^k cells, of amplitude 1/8 each",
            format!("[bake]\noctave_fade = false\n{}", layer("octaves = 8\ngain = 1\nnormalise = true")),
            Look::at(0.02).within(2e-4),
        ),
        case(
            "a gain of 3",
            "the definition within 1e-4 of the peak: places to 5e-7, times the slope of the finest octave that is left, of 48 cells",
            layer("octaves = 12\ngain = 3"),
            Look::at(0.02).within(1e-4),
        ),
        case(
            "a lacunarity of 1",
            "the definition within 2e-5 of the peak: eight octaves of 3 cells",
            layer("octaves = 8\nlacunarity = 1"),
            Look::at(0.02).within(2e-5),
        ),
        case(
            "a lacunarity of 0.5",
            "the definition within 4e-6 of the peak",
            layer("octaves = 8\nlacunarity = 0.5"),
            Look::at(0.02),
        ),
        Case::new(GROUP, "a lacunarity of 0", "refused", || {
            refuses(
                "[[tube]]\ncurve = { points = [[0,0,0],[1,0,0],[2,0,0]] }\n[[tube.layer]]\nlacunarity = 0\n",
                "above 0",
            )
        }),
        case(
            "a frequency of 0",
            "the definition within 4e-6 of the peak",
            layer("frequency = 0"),
            Look::at(0.02),
        ),
        case("a frequency of 1e9", "the mean, 0: all octaves fade", layer("frequency = 1e9"), Look::at(0.02)),
        case(
            "an offset of 1e9 cells",
            "the definition within 1e-4 of the peak: places in cells to 1e-7",
            layer("octaves = 3\noffset = [1e9, -1e9, 1e9]\nfrequency = 1"),
            Look::at(0.02).within(1e-4),
        ),
        case(
            "a warp of 1000 cells",
            "the definition within 8e-3 of the peak: a warp off by 2e-6 of itself moves noise, of slope 3.75, by 2e-3 cells",
            layer("octaves = 1\nfrequency = 1\nwarp = { amplitude = 1000, octaves = 1 }"),
            Look::at(0.02).within(8e-3),
        ),
        case(
            "density below 0 by noise",
            "0 there, and the definition elsewhere within 2e-5 of the peak",
            layer("octaves = 3\nmultiplier = 5"),
            Look::at(0.02).within(2e-5),
        ),
        case(
            "a multiplier of 1e-40",
            "denormal numbers: half a step of 1.4e-45, 2e-5 of a peak of 4e-41 and more",
            layer("octaves = 3\nmultiplier = 1e-40\nthreshold = -1\nop = \"multiply\"")
                .replace("op = \"add\"\n", ""),
            Look::at(0.02).within(2e-5),
        ),
        Case::new(GROUP, "six layers of 1e9", "refused: 1e54 does not fit single precision", || {
            let layers = "[[tube.layer]]\nnoise = \"constant\"\nvalue = 1e9\n".repeat(6);
            refuses(&quadratic(&BENT, &format!("radius = 0.25\n{layers}")), "too large")
        }),
        case(
            "sectors of 1e4 turns",
            "the definition within 1e-3 of the peak, but beside the sectors' planes",
            quadratic(&STRAIGHT, "radius = 0.25\ntwist = 1e4\n[[tube.layer]]\nnoise = \"sectors\""),
            Look::at(0.02).within(1e-3).beside_jumps(2e-2),
        ),
        case(
            "a knot with folds, warps and turned octaves",
            "the definition within 1e-3 of the peak: the warp's slope times everything else",
            of_kind(
                "b-spline",
                &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0], [1.0, 1.0, 0.0]],
                "radius = [[0, 0.05], [0.5, 0.2], [1, 0.05]]\ntwist = -7\n[[tube.layer]]\nop = \"add\"\nform = \"ridged\"\n\
                 rotate = true\nwarp = { amplitude = 1 }",
            ),
            Look::at(0.02).within(1e-3),
        ),
    ];
    for turns in [100.0, 1e4] {
        let tube = format!("radius = 0.25\ntwist = {turns}\n[[tube.layer]]\nop = \"add\"\noctaves = 2");
        // Faded, nothing of the noise would be left to be off.
        let text = format!("[bake]\noctave_fade = false\n{}", quadratic(&BENT, &tube));
        let bound = 1e-7 * turns + PLAIN;
        cases.push(case(
            &format!("{turns} turns of twist, unfaded"),
            "the definition within 1e-7 of the peak a turn: a place off by 1e-7 of the length",
            text,
            Look::at(0.02).within(bound),
        ));
    }
    cases
}

/// Octaves above 1.6 cells a voxel have no part: at voxels of 0.02 m and a radius of 0.25 m, from octave 5 of a frequency of 2 on.
fn faded() -> Verdict {
    let bits = |octaves: u32| {
        let text = quadratic(
            &BENT,
            &format!("radius = 0.25\n[[tube.layer]]\nop = \"add\"\nfrequency = 2\noctaves = {octaves}"),
        );
        probe(&text, 0.02).map(|probe| {
            let mut store = Store::default();
            let Ok((tally, _)) = bake(&probe.field, &probe.plan, 0.0, Level::best(), &mut store, |_| ());
            tally.content_hash
        })
    };
    match (bits(24), bits(6)) {
        (Ok(many), Ok(few)) => Verdict::is(many == few, if many == few { "equal" } else { "they differ" }),
        (Err(error), _) | (_, Err(error)) => Verdict::failed(error),
    }
}
