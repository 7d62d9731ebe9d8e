//! Motion derived from a temporal field, and conversion of its first frame to a static field.

use faer::prelude::Solve;
use faer::{Mat, Side};
use gradreel::optim::Params;
use gradreel::{Error, ErrorKind, Key, Result, Tape};

use super::render::TemporalField;
use crate::constant;
use crate::field::{DenseGrid, RadianceField, RadianceSizes, opacity, opacity_shift};

/// The position of an object over time.
#[derive(Debug, Clone, PartialEq)]
pub struct FieldMotion {
    /// Times \[s\].
    pub times: Vec<f64>,
    /// Opacity-weighted centroids \[m\].
    pub centroids: Vec<[f64; 3]>,
    /// Height of the lowest opaque node \[m\].
    pub lowest: Vec<f64>,
}

/// Opacity over one unit of length above which a node counts as opaque.
const OPAQUE: f64 = 0.5;

impl TemporalField {
    /// The motion of the object, evaluated on about `nodes` nodes over the box. `moments` are normalised times in 0…1,
    /// `times` the same in seconds.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the field is empty at some time, or the store holds no such field.
    pub fn motion(&self, params: &Params, moments: &[f64], times: &[f64], nodes: usize) -> Result<FieldMotion> {
        let grid = DenseGrid::of_count(self.grid.low, self.grid.high, nodes)?;
        let points = grid.nodes();
        let shift = opacity_shift(self.settings.opacity);
        let mut motion = FieldMotion { times: times.to_vec(), centroids: Vec::new(), lowest: Vec::new() };
        for &moment in moments {
            let density = self.density_at(params, &points, moment)?;
            let (mut sum, mut mass, mut lowest) = ([0.0; 3], 0.0, f64::INFINITY);
            for (x, d) in points.iter().zip(density) {
                let alpha = opacity(d, shift, 1.0);
                // residual opacity of an empty field must not bias the centroid to the box's centre
                if alpha >= OPAQUE {
                    (0..3).for_each(|axis| sum[axis] += alpha * x[axis]);
                    mass += alpha;
                    lowest = lowest.min(x[1]);
                }
            }
            if mass == 0.0 {
                return Err(Error::new(ErrorKind::Input, "the temporal field is empty")
                    .at(format!("time {moment} of 0 to 1"))
                    .fix("fit it longer, or check the masks and cameras with `gradreel check`"));
            }
            motion.centroids.push(sum.map(|s| s / mass));
            motion.lowest.push(lowest);
        }
        Ok(motion)
    }

    /// The static field of the first frame on another grid, such as that of the simulation. Density is evaluated at its
    /// nodes; the first `sizes.features` channels are resampled (missing ones are 0); the colour network is new. A few
    /// iterations of the static stage adapt it to the first frame.
    ///
    /// # Errors
    /// When the store holds no such field.
    pub fn baked(
        &self,
        params: &Params,
        grid: DenseGrid,
        sizes: RadianceSizes,
        key: Key,
    ) -> Result<(RadianceField, Params)> {
        let field = RadianceField::new(grid, self.settings.opacity, sizes);
        let stored = params.get("temporal.feature")?;
        let mut still = field.initialise(key, stored.dtype())?;
        let [x, y, z] = field.grid.dims;
        let density = self.density_at(params, &field.grid.nodes(), 0.0)?;
        let tape = Tape::new();
        let features = self.grid.resampled(&tape.constant(stored.clone()), &field.grid)?;
        let (have, want) = (features.dims()[3], field.sizes.features);
        let features = if have > want { features.slice(3, 0..want) } else { features.pad(3, 0, want - have) };
        still.set("radiance.density", constant::numbers(&features, density, [x, y, z, 1])?.value()?.clone());
        still.set("radiance.features", features.value()?.clone());
        Ok((field, still))
    }
}

impl FieldMotion {
    /// The first time at which the object is within `reach` \[m\] of the ground, as an index into
    /// [`FieldMotion::times`].
    pub fn first_contact(&self, ground: f64, reach: f64) -> Option<usize> {
        self.lowest.iter().position(|y| *y <= ground + reach)
    }

    /// Position \[m\] and velocity \[m/s\] at the first time, by a least-squares fit of `x₀ + v t + g t²/2` to the
    /// first `frames` centroids.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] with fewer than two distinct times.
    pub fn ballistic(&self, gravity: [f64; 3], frames: usize) -> Result<([f64; 3], [f64; 3])> {
        let count = frames.min(self.times.len());
        let since: Vec<f64> = self.times[..count].iter().map(|t| t - self.times[0]).collect();
        let too_few = || Error::new(ErrorKind::Input, "a velocity needs two frames before contact").found(count);
        if !since.iter().any(|t| *t > 0.0) {
            return Err(too_few());
        }
        let design = Mat::from_fn(count, 2, |i, j| if j == 0 { 1.0 } else { since[i] });
        let wanted =
            Mat::from_fn(count, 3, |i, axis| self.centroids[i][axis] - 0.5 * gravity[axis] * since[i] * since[i]);
        let normal = design.transpose() * &design;
        let right = design.transpose() * &wanted;
        let solution = normal.llt(Side::Lower).map_err(|_| too_few())?.solve(&right);
        Ok(([0, 1, 2].map(|axis| solution[(0, axis)]), [0, 1, 2].map(|axis| solution[(1, axis)])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_fall_is_found_again() {
        let times: Vec<f64> = (0..5).map(|i| 0.5 + 0.04 * f64::from(i)).collect();
        let (x, v, g) = ([0.1, 1.0, -0.2], [0.5, -1.0, 0.25], [0.0, -9.8, 0.0]);
        let place = |t: &f64| [0, 1, 2].map(|a| x[a] + v[a] * (t - 0.5) + 0.5 * g[a] * (t - 0.5).powi(2));
        let centroids: Vec<_> = times.iter().map(place).collect();
        let lowest = centroids.iter().map(|c| c[1] - 0.1).collect();
        let motion = FieldMotion { times, centroids, lowest };
        let (start, velocity) = motion.ballistic(g, 4).unwrap();
        assert!((0..3).all(|a| (start[a] - x[a]).abs() < 1e-12 && (velocity[a] - v[a]).abs() < 1e-10));
        assert_eq!(motion.first_contact(0.6, 0.06), Some(4));
        assert_eq!(motion.first_contact(0.0, 0.06), None);
        assert!(motion.ballistic(g, 1).is_err());
    }
}
