//! What a law answers to extension, shear and change of volume.

use super::response::IDENTITY;
use crate::physics::law::Law;

/// The stress along one kind of deformation.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// `uniaxial`, `shear` or `volumetric`.
    pub name: &'static str,
    /// Strain and Kirchhoff stress \[Pa\]: the axial ones of `F = diag(1 + ε, 1, 1)`, `τ_xy` of a shear `γ`, and a third of the
    /// trace of `τ` over a change of length `ε` along all axes.
    pub points: Vec<(f64, f64)>,
}

/// Largest strain.
const STRAIN: f64 = 0.3;
/// Steps to it.
const STEPS: usize = 120;
/// Strain rate \[1/s\].
const RATE: f64 = 1.0;

/// The responses of a law with these parameters, from rest to a strain of 0.3 on both sides, at a strain rate of 1/s; return
/// map and history are applied in 120 steps.
///
/// # Panics
///
/// If the law has another number of parameters.
#[track_caller]
pub fn responses(law: &Law, values: &[f64]) -> [Response; 3] {
    assert!(values.len() == law.parameters().len(), "{} has {} parameters", law.name(), law.parameters().len());
    let kinds: [(&str, [usize; 3], bool); 3] =
        [("uniaxial", [0, 0, 0], false), ("shear", [1, 1, 1], false), ("volumetric", [0, 4, 8], true)];
    kinds.map(|(name, entries, mean)| {
        let side = |sign: f64| {
            let mut f = IDENTITY;
            let mut history: Vec<f64> = law.history().iter().map(|variable| variable.start).collect();
            let step = STRAIN / STEPS as f64;
            let follow = |n: usize| {
                // (I + dt C) takes the last strain to the next
                let last = sign * step * n as f64;
                let rate = sign * RATE / if entries[0] == 1 { 1.0 } else { 1.0 + last };
                let mut c = [0.0; 9];
                entries.iter().for_each(|&k| c[k] = rate);
                let inputs = [&f[..], &c, &[step / RATE], values, &history].concat();
                let found = law.program().eval(&inputs);
                f.copy_from_slice(&found[..9]);
                history.copy_from_slice(&found[18..]);
                let tau = &found[9..18];
                let stress = if mean { (tau[0] + tau[4] + tau[8]) / 3.0 } else { tau[entries[0]] };
                (last + sign * step, stress)
            };
            (0..STEPS).map(follow).collect::<Vec<_>>()
        };
        let mut points: Vec<(f64, f64)> = side(-1.0);
        points.reverse();
        points.extend(side(1.0));
        Response { name, points }
    })
}
