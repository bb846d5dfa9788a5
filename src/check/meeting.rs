//! Where tubes of a scene run through each other.

use std::collections::BTreeMap;

use rayon::prelude::*;

use super::hazard::Hazard;
use crate::reference::Reference;
use crate::report::page::words::{figure, part};
use crate::report::random;
use crate::scene::{Key, Overlap, Scene, Weight};
use crate::volume::Plan;

/// Voxels that are looked at.
const VOXELS: u64 = 1 << 13;
/// Pairs of tubes that are told of.
const PAIRS: usize = 3;
/// Stream of random numbers.
const STREAM: u64 = 0x6d65_6574;

/// Two tubes at the voxels in both.
#[derive(Debug, Clone, Copy)]
struct Meeting {
    voxels: u64,
    /// Least and greatest arc length along each, metres.
    along: [[f64; 2]; 2],
}

/// What tubes share, at voxels of a bake's plan that are chosen evenly: pairs of tubes, those that share most first.
pub fn meetings(scene: &Scene, plan: &Plan) -> Vec<Hazard> {
    let tubes = scene.tubes();
    if tubes.len() < 2 || plan.bricks() == 0 {
        return vec![];
    }
    let h = plan.lattice().voxel_size;
    let reference = Reference::new(scene, Some(h));
    let lengths: Vec<f64> = (0..tubes.len()).map(|tube| reference.length(tube)).collect();
    let found: Vec<Vec<(usize, [f64; 2])>> = (0..VOXELS)
        .into_par_iter()
        .map(|number| {
            let bits = random::bits(STREAM, number);
            let brick = usize::try_from(number * plan.bricks() as u64 / VOXELS).unwrap_or_default();
            let origin = plan.origin(brick);
            let place = |axis: usize| {
                let within = i32::try_from(bits >> (8 * axis) & 7).unwrap_or_default();
                (f64::from(origin[axis]) + f64::from(within) + 0.5) * h
            };
            let at = [place(0), place(1), place(2)];
            let along = |tube: usize| {
                let feet = reference.inside(tube, at);
                let ends = feet.iter().map(|foot| foot.fraction * lengths[tube]);
                let ends = ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], s| [a.min(s), b.max(s)]);
                (!feet.is_empty()).then_some((tube, ends))
            };
            (0..tubes.len()).filter_map(along).collect()
        })
        .collect();
    let inside = found.iter().filter(|tubes| !tubes.is_empty()).count();
    let mut meetings: BTreeMap<[usize; 2], Meeting> = BTreeMap::new();
    for tubes in &found {
        for (first, (a, one)) in tubes.iter().enumerate() {
            for (b, other) in &tubes[first + 1..] {
                let meeting =
                    meetings.entry([*a, *b]).or_insert(Meeting { voxels: 0, along: [*one, *other] });
                meeting.voxels += 1;
                for (kept, new) in meeting.along.iter_mut().zip([one, other]) {
                    *kept = [kept[0].min(new[0]), kept[1].max(new[1])];
                }
            }
        }
    }
    let mut meetings: Vec<_> = meetings.into_iter().collect();
    meetings.sort_by_key(|(_, meeting)| std::cmp::Reverse(meeting.voxels));
    let rest = meetings.len().saturating_sub(PAIRS);
    let say = |([a, b], meeting): ([usize; 2], Meeting)| {
        #[allow(clippy::cast_precision_loss, reason = "a share")]
        let share = meeting.voxels as f64 / inside as f64;
        let span = |tube: usize, [low, high]: [f64; 2]| {
            format!("from {} to {} m along \"{}\"", figure(low), figure(high), tubes[tube].name)
        };
        let jumps = scene.overlap() == Overlap::Closest;
        let more = if rest > 0 { format!("; {rest} more pairs share less") } else { String::new() };
        let help = if jumps {
            "`overlap = \"closest\"` jumps where two axes are equally far: \"max\", \"sum\" and \"blend\" do not"
        } else {
            "`overlap` of the scene says what is stored there: \"max\" (the union), \"sum\", \"closest\" or \"blend\""
        };
        Hazard::new(
            "tubes overlap",
            share,
            scene.remark(
                if jumps { Weight::Warning } else { Weight::Note },
                &[Key::Name("tube"), Key::Number(b), Key::Name("curve")],
                format!(
                    "tubes \"{}\" and \"{}\" share {} of the voxels inside of tubes{more}",
                    tubes[a].name,
                    tubes[b].name,
                    part(share)
                ),
                format!("{}, {}", span(a, meeting.along[0]), span(b, meeting.along[1])),
                help.to_owned(),
            ),
        )
    };
    meetings.into_iter().take(PAIRS).map(say).collect()
}
