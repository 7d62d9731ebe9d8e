//! Particles seeded from a radiance field, differentiable in density and features.

use gradreel::{Error, ErrorKind, Key, Result, Var};

use crate::constant;
use crate::field::{Occupancy, channel, opacity};

/// Selection of the sites of a field that become particles.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Seeding {
    /// Whether sites are exactly half a spacing apart. The published grid has `2 (N − 1)` sites between the first node
    /// and half a spacing beyond the last, which are 1–2 % further apart.
    pub exact: bool,
    /// Minimum opacity of a particle, relative to the most opaque site.
    pub least_opacity: f64,
}

impl Default for Seeding {
    fn default() -> Self {
        Self { exact: false, least_opacity: 1e-3 }
    }
}

/// Position of each particle in its cube.
#[derive(Debug, Clone)]
pub enum Jitter {
    /// Drawn from a key, independently for each site.
    Drawn(Key),
    /// Given, in 0…1 per axis, for each occupied site in the order of `Seeding::places`.
    Given(Vec<[f64; 3]>),
}

/// Material points with opacity and features from the field.
#[derive(Debug, Clone)]
pub struct Seeded {
    /// Positions \[m\], `[n, 3]`, constant.
    pub positions: Var,
    /// Opacity over one unit of length, `[n]` in 0…1.
    pub opacity: Var,
    /// Raw density and features, `[n, 1 + features]`.
    pub features: Var,
}

impl Seeding {
    /// The occupied candidate sites \[m\], z fastest.
    pub fn places(&self, occupancy: &Occupancy) -> Vec<[f64; 3]> {
        let grid = &occupancy.grid;
        let along = |axis: usize| -> Vec<f64> {
            let nodes = grid.dims[axis];
            let count = 2 * (nodes - 1);
            let apart = if self.exact { 0.5 } else { (nodes as f64 - 0.5) / (count as f64 - 1.0) };
            (0..count).map(|i| grid.low[axis] + i as f64 * apart * grid.spacing).collect()
        };
        let [xs, ys, zs] = [0, 1, 2].map(along);
        let mut places = Vec::new();
        for &x in &xs {
            for &y in &ys {
                places.extend(zs.iter().map(|&z| [x, y, z]).filter(|place| occupancy.contains(*place)));
            }
        }
        places
    }

    /// Seeds particles at the occupied sites of a field: each is displaced by up to half a spacing along each axis, and
    /// kept if it is opaque enough there. The selection is not differentiated; opacity and features are.
    ///
    /// `values` holds raw density and features, `[x, y, z, 1 + features]`; `shift` is added to the densities.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the field is empty, or the given jitter has another number of sites.
    pub fn seed(&self, occupancy: &Occupancy, values: &Var, shift: f64, jitter: &Jitter) -> Result<Seeded> {
        let grid = &occupancy.grid;
        let mut places = self.places(occupancy);
        let half = grid.spacing / 2.0;
        match jitter {
            Jitter::Drawn(key) => {
                let mut u = key.uniform(3 * places.len());
                places.as_flattened_mut().iter_mut().for_each(|x| *x += half * u.next().unwrap_or(0.0));
            }
            Jitter::Given(units) if units.len() == places.len() => {
                places.iter_mut().zip(units).for_each(|(x, u)| (0..3).for_each(|axis| x[axis] += half * u[axis]));
            }
            Jitter::Given(units) => {
                return Err(Error::new(ErrorKind::Input, "the jitter is not that of the occupied places")
                    .found(format!("{} rows for {} places", units.len(), places.len()))
                    .fix("give one row for each place of Seeding::places"));
            }
        }
        let (density, scale) = (channel(values.value()?, 0)?, grid.scale());
        let alpha: Vec<f64> = places.iter().map(|&x| opacity(grid.at(&density, &scale, x), shift, 1.0)).collect();
        let least = self.least_opacity * alpha.iter().fold(0.0, |most: f64, a| most.max(*a));
        let kept: Vec<_> = places.iter().zip(&alpha).filter(|(_, alpha)| **alpha >= least).map(|(x, _)| *x).collect();
        if kept.is_empty() {
            return Err(Error::new(ErrorKind::Input, "no particle can be seeded: no node of the field is occupied")
                .fix("check the masks and cameras of the first frame with `gradreel check`"));
        }
        let positions = constant::points(values, &kept)?;
        let features = grid.lookup(values, &positions)?;
        let opacity = features.slice(1, 0..1).reshape([kept.len()]).density_to_alpha(shift, 1.0);
        Ok(Seeded { positions, opacity, features })
    }
}
