//! Where a tube's cross-section jumps: at the seam of a closed curve that does not meet itself, and where a Frenet frame flips.

use super::error::Fault;
use super::reader::{Item, Reader};
use super::{Pattern, Space, Tube};
use crate::curve::FrameRule;

/// Parts of a turn, and of a radius, that are taken for none.
const NONE: f64 = 1e-9;
/// Radians by which a frame may miss itself.
const CLOSED: f64 = 1e-6;

/// Warns of the places where a Frenet frame flips, by l from 0 to 1, as for the radius.
pub(super) fn flips(table: &Reader<'_>, tube: &Tube) {
    /// Places that are listed.
    const MOST: usize = 4;
    let (flips, length) = (tube.curve.flips(), tube.curve.length());
    let (Some(item), false) = (table.get("frame"), flips.is_empty()) else { return };
    let places: Vec<String> = flips.iter().take(MOST).map(|s| format!("{:.4}", s / length)).collect();
    let more = flips.len() - places.len();
    let rest = if more > 0 { format!(" and at {more} more places") } else { String::new() };
    table.warn(
        Fault::at(item.span(), format!("the Frenet frame flips at l = {}{rest}", places.join(", ")))
            .label("and the noise with it; \"rotation-minimising\" does not"),
    );
}

/// Warns of each seam of a closed tube.
pub(super) fn warn(table: &Reader<'_>, tube: &Tube, closed: &Item<'_>) {
    let seam = |key: &'static str, label: String| {
        let at = table.get(key).map_or(closed.span(), |item| item.span());
        let fault = Fault::at(at, "a seam where the curve closes").label(label);
        table.warn(fault.related(closed.span(), "the curve is closed here"));
    };
    if let Some(order) = tube.layers.iter().filter_map(|layer| symmetry(&layer.pattern)).reduce(f64::min) {
        let turns = tube.twist * order;
        if (turns - turns.round()).abs() > NONE {
            let whole = if order > 1.0 { "whole numbers of half turns" } else { "whole numbers of turns" };
            seam(
                "twist",
                format!("after {} turns the layers do not meet themselves; {whole} close", tube.twist),
            );
        }
        if tube.frame == FrameRule::Frenet && tube.curve.holonomy().abs() > CLOSED {
            let degrees = tube.curve.holonomy().to_degrees();
            let label = format!(
                "the Frenet frame arrives turned by {degrees:.1} degrees; \"rotation-minimising\" closes"
            );
            seam("frame", label);
        }
    }
    let step = tube.radius.step_around();
    if step.abs() > NONE * tube.radius.max() {
        seam("radius", format!("the radius is {:+.3e} m off where it comes round", step));
    }
}

/// In how many positions of a turn a pattern looks the same; `None` in all.
fn symmetry(pattern: &Pattern) -> Option<f64> {
    match pattern {
        Pattern::Constant(_) => None,
        Pattern::Sectors => Some(2.0),
        // One in the world's coordinates does not turn with the tube.
        Pattern::Perlin(fbm) => (fbm.octaves > 0 && fbm.space == Space::Cylinder).then_some(1.0),
    }
}
