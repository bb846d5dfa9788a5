//! A tube's radius, as the scene gives it and as a lattice can show it.

use super::span::LEAST_RADIUS;
use crate::curve::Profile;

/// A tube of radius 0 is widened to this many voxels: of those below 2 the radius at which the smooth envelope's mass, summed
/// over voxels, depends least on where among them the axis runs, 3 %.
const WIDENED: f64 = 1.5;

/// Radius in metres over the fraction of the arc length.
#[derive(Debug, Clone)]
pub(crate) struct Radius {
    profile: Profile,
    /// Edge of the voxel that thin parts are widened to.
    voxel: Option<f64>,
}

impl Radius {
    /// The tube's own radius.
    pub(crate) fn new(profile: &Profile) -> Radius {
        Radius { profile: profile.clone(), voxel: None }
    }

    /// Widens what is thin for voxels of edge `h`, and nothing for another; whether that changes any radius.
    pub(crate) fn widen(&mut self, h: f64) -> bool {
        let is_thin = self.profile.range(0.0, 1.0).0 < 2.0 * WIDENED * h;
        let before = self.voxel;
        self.voxel = is_thin.then_some(h);
        self.voxel != before
    }

    /// Whether some of it is widened.
    pub(crate) fn is_widened(&self) -> bool {
        self.voxel.is_some()
    }

    /// The scene's own.
    pub(crate) fn own(&self, x: f64) -> f64 {
        self.profile.at(x)
    }

    /// The radius at x; at a jump the one after it.
    pub(crate) fn at(&self, x: f64) -> f64 {
        self.widened(self.profile.at(x))
    }

    /// Least and greatest for x in an interval; of a jump in it or at its ends both sides count.
    pub(crate) fn range(&self, x: [f64; 2]) -> [f64; 2] {
        let (least, most) = self.profile.range(x[0], x[1]);
        [self.widened(least), self.widened(most)]
    }

    /// Whether there is no tube at x, at a jump after it.
    pub(crate) fn vanishes_at(&self, x: f64) -> bool {
        self.profile.at(x) <= LEAST_RADIUS * self.profile.max()
    }

    /// Whether there is no tube anywhere in an interval.
    pub(crate) fn vanishes(&self, x: [f64; 2]) -> bool {
        self.profile.range(x[0], x[1]).1 <= LEAST_RADIUS * self.profile.max()
    }

    /// Whether there is a tube everywhere in an interval.
    pub(crate) fn lasts(&self, x: [f64; 2]) -> bool {
        self.profile.range(x[0], x[1]).0 > LEAST_RADIUS * self.profile.max()
    }

    /// A radius that is not smaller than the least where there is a tube, to divide by.
    pub(crate) fn divisor(&self, radius: f64) -> f64 {
        radius.max(LEAST_RADIUS * self.profile.max())
    }

    /// Where in (0, 1) it is not smooth.
    pub(crate) fn knots(&self) -> &[f64] {
        self.profile.knots()
    }

    /// Whether it is the same everywhere.
    pub(crate) fn is_constant(&self) -> bool {
        self.profile.as_constant().is_some()
    }

    fn widened(&self, own: f64) -> f64 {
        let Some(h) = self.voxel else { return own };
        let least = WIDENED * h;
        if own >= 2.0 * least { own } else { least + own * own / (4.0 * least) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widening_keeps_the_order_of_radii_and_ends_at_three_voxels() {
        let profile = Profile::keyed(&[(0.0, 0.0), (1.0, 4.0)]).expect("two keys");
        let mut radius = Radius::new(&profile);
        assert!(radius.widen(1.0) && radius.is_widened());
        let mut before = 0.0;
        for step in 0..=4000 {
            let x = f64::from(step) / 4000.0;
            let (own, widened) = (radius.own(x), radius.at(x));
            assert!(widened > before || step == 0, "at {own}");
            assert!(widened >= own && (own < 3.0 || widened == own));
            before = widened;
        }
        assert_eq!(radius.at(0.0), WIDENED);
        assert!(!radius.widen(1.0) && radius.is_widened());
        assert!(radius.widen(0.5) && radius.is_widened());
        assert_eq!(radius.at(0.0), 0.5 * WIDENED);
        assert!(!Radius::new(&Profile::constant(3.0).expect("a radius")).widen(1.0));
    }
}
