//! Mass, momentum and energy of all particles at one time.

use serde::{Deserialize, Serialize};

use crate::physics::{Number, State};

/// Sums over all particles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Totals {
    /// Time since the start \[s\].
    pub time_s: f64,
    /// Mass \[kg\].
    pub mass_kg: f64,
    /// Centre of mass \[m\].
    pub centre_m: [f64; 3],
    /// Momentum \[kg m/s\].
    pub momentum_kg_m_s: [f64; 3],
    /// Angular momentum about the origin \[kg m²/s\], including that of the affine velocities.
    pub angular_momentum_kg_m2_s: [f64; 3],
    /// Kinetic energy `½ Σ m v²` \[J\].
    pub kinetic_j: f64,
    /// Gravitational potential energy, `−Σ m g·x` \[J\]. Elastic energy is not included.
    pub potential_j: f64,
    /// Speed of the fastest particle \[m/s\].
    pub fastest_m_s: f64,
    /// Minimum and maximum volume ratio of a particle, `det F`.
    pub volume_ratio: [f64; 2],
}

impl Totals {
    /// The totals of a state; `mass(p)` is the mass of particle `p` \[kg\], `dx` the grid spacing \[m\].
    pub fn of<T: Number>(
        state: &State<T>,
        mass: impl Fn(usize) -> f64,
        gravity: [f64; 3],
        dx: f64,
        time_s: f64,
    ) -> Self {
        let mut sum = Self {
            time_s,
            mass_kg: 0.0,
            centre_m: [0.0; 3],
            momentum_kg_m_s: [0.0; 3],
            angular_momentum_kg_m2_s: [0.0; 3],
            kinetic_j: 0.0,
            potential_j: 0.0,
            fastest_m_s: 0.0,
            volume_ratio: [f64::INFINITY, f64::NEG_INFINITY],
        };
        let spin = dx * dx / 4.0;
        let (xs, vs) = (state.positions(), state.velocities());
        let (cs, fs) = (state.affine_velocities(), state.deformation_gradients());
        for p in 0..state.len() {
            let m = mass(p);
            let (x, v) = (xs[p].map(|x| x.to_f64()), vs[p].map(|v| v.to_f64()));
            let square: f64 = v.iter().map(|v| v * v).sum();
            sum.mass_kg += m;
            sum.kinetic_j += 0.5 * m * square;
            sum.fastest_m_s = sum.fastest_m_s.max(square.sqrt());
            for (i, j, k) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
                sum.centre_m[i] += m * x[i];
                sum.momentum_kg_m_s[i] += m * v[i];
                sum.potential_j -= m * gravity[i] * x[i];
                let affine = spin * (cs[p][k][j].to_f64() - cs[p][j][k].to_f64());
                sum.angular_momentum_kg_m2_s[i] += m * (x[j] * v[k] - x[k] * v[j] + affine);
            }
            let f = fs[p].map(|row| row.map(|f| f.to_f64()));
            let ratio = f[0][0] * (f[1][1] * f[2][2] - f[1][2] * f[2][1])
                - f[0][1] * (f[1][0] * f[2][2] - f[1][2] * f[2][0])
                + f[0][2] * (f[1][0] * f[2][1] - f[1][1] * f[2][0]);
            sum.volume_ratio = [sum.volume_ratio[0].min(ratio), sum.volume_ratio[1].max(ratio)];
        }
        sum.centre_m = sum.centre_m.map(|x| x / sum.mass_kg);
        sum
    }
}
