//! Values as colours, for a quick look.

use colorous::INFERNO;

use super::source::Plane;

/// Inferno of Smith and van der Walt (2015), whose lightness grows evenly: black at 0 and below, bright at `white`; what is
/// not a number is cyan, which it has nowhere.
fn colour(value: f32, white: f32) -> [u8; 3] {
    if value.is_nan() {
        return [0, 255, 255];
    }
    let part = if white > 0.0 { (value / white).clamp(0.0, 1.0) } else { 0.0 };
    let colour = INFERNO.eval_continuous(f64::from(part));
    [colour.r, colour.g, colour.b]
}

/// The colours of a plane; `None` of vectors.
pub(super) fn colours(plane: &Plane, white: f32) -> Option<Vec<[u8; 3]>> {
    match plane {
        Plane::Numbers(values) => Some(values.iter().map(|value| colour(*value, white)).collect()),
        Plane::Vectors(_) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_is_lighter() {
        // Rec. 709 luma of sRGB colours stands for lightness well enough to order them.
        let light = |value| {
            let [r, g, b] = colour(value, 2.0).map(f64::from);
            0.2126 * r + 0.7152 * g + 0.0722 * b
        };
        for step in 0_u8..200 {
            let value = f32::from(step) / 100.0;
            assert!(light(value + 0.01) > light(value) - 0.6, "{value}");
        }
        assert!(light(0.0) < 5.0 && light(2.0) > 240.0);
        assert_eq!(colour(-1.0, 2.0), colour(0.0, 2.0));
        assert_eq!(colour(9.0, 2.0), colour(2.0, 2.0));
        assert_eq!(colour(1.0, 0.0), colour(0.0, 1.0));
        assert_eq!(colour(f32::NAN, 1.0), [0, 255, 255]);
    }
}
