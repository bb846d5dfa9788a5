//! Orders of convergence.

use serde::{Deserialize, Serialize};

/// An error that falls as a power of the voxel size: `constant h^order`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Order {
    /// The power.
    pub order: f64,
    /// The error at a voxel of 1 m, were it to go on so.
    pub constant: f64,
    /// Standard error of the power, from how far the points lie off the line; null for fewer than three.
    pub uncertainty: Option<f64>,
}

impl Order {
    /// The line of least squares through the logarithms of voxel sizes and errors; `None` for fewer than two voxel sizes, or
    /// where an error is not above 0.
    pub fn fit(points: &[[f64; 2]]) -> Option<Order> {
        let valid = |point: &[f64; 2]| point.iter().all(|x| *x > 0.0 && x.is_finite());
        if points.len() < 2 || !points.iter().all(valid) {
            return None;
        }
        let logs: Vec<[f64; 2]> = points.iter().map(|point| point.map(libm::log)).collect();
        #[allow(clippy::cast_precision_loss, reason = "few")]
        let count = logs.len() as f64;
        let mean = [0, 1].map(|axis| logs.iter().map(|log| log[axis]).sum::<f64>() / count);
        let sum = |of: fn([f64; 2]) -> f64| -> f64 {
            logs.iter().map(|log| of([log[0] - mean[0], log[1] - mean[1]])).sum()
        };
        let [xx, xy] = [sum(|[x, _]| x * x), sum(|[x, y]| x * y)];
        if xx <= 0.0 {
            return None;
        }
        let order = xy / xx;
        let rest: f64 = (logs.iter())
            .map(|log| log[1] - mean[1] - order * (log[0] - mean[0]))
            .map(|residual| residual * residual)
            .sum();
        let uncertainty = (count > 2.0).then(|| (rest / (count - 2.0) / xx).sqrt());
        Some(Order { order, constant: libm::exp(mean[1] - order * mean[0]), uncertainty })
    }

    /// The voxel size at which the error would be this.
    pub fn voxel_size(&self, error: f64) -> f64 {
        libm::pow(error / self.constant, 1.0 / self.order)
    }

    /// The error at a voxel size.
    pub fn error(&self, voxel_size: f64) -> f64 {
        self.constant * libm::pow(voxel_size, self.order)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_are_found() {
        let points = [0.1, 0.05, 0.02].map(|h: f64| [h, 3.0 * libm::pow(h, 1.7)]);
        let found = Order::fit(&points).expect("three points");
        assert!((found.order - 1.7).abs() < 1e-12 && (found.constant - 3.0).abs() < 1e-10);
        assert!(found.uncertainty.is_some_and(|off| off < 1e-12));
        assert!((found.voxel_size(found.error(0.01)) - 0.01).abs() < 1e-12);
        // One point a tenth too high: a slope that is off by about what it says.
        let off = [points[0], points[1], [points[2][0], 1.1 * points[2][1]]];
        let found = Order::fit(&off).expect("three points");
        assert!((found.order - 1.7).abs() < 0.1 && found.uncertainty.is_some_and(|off| off > 1e-3));
        assert_eq!(Order::fit(&points[..1]), None);
        assert_eq!(Order::fit(&[[0.1, 1.0], [0.1, 2.0]]), None);
        assert_eq!(Order::fit(&[[0.1, 1.0], [0.2, 0.0]]), None);
    }
}
