//! The columns of the covariance: how far the unknowns may be off together, however many pixels say otherwise.

use super::error_budget::Discrepancy;
use crate::identify::model::unknowns::Unknown;
use crate::identify::{Free, Unknowns};
use crate::physics::{Law, Map, Parameter};

/// Deviation of the ground's friction by the model \[decades\]: it acts on the nodes of the grid, a share of a cell before the body
/// touches.
const ROUGH: f64 = 0.1;

/// What decides how large discrepancies are.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Resolution {
    /// Grid spacing \[m\].
    pub dx: f64,
    /// Diameter of the ball of the body's volume \[m\].
    pub diameter: f64,
    /// Time from the first frame to the last \[s\].
    pub filmed: f64,
    /// The pressure `ρv²` with which the body meets the ground \[Pa\].
    pub impact: f64,
    /// Density of the body \[kg/m³\].
    pub density: f64,
    /// Standard deviation of all lengths, as a share: of what a single camera saw fall.
    pub length: f64,
    /// Whether a single camera saw the body, and not the other side.
    #[serde(default)]
    pub one_camera: bool,
}

/// How far a parameter may be off: in decades if it is fitted as a logarithm, in its unit otherwise.
///
/// A grid gets strains wrong by a share of its cells over the body's width `c`, and stresses by that share of the pressure of the impact. Of
/// a stiff body, which an impact deforms by `√(ρv²/E)`, the first is what counts, of a soft one the second; a fluid is compressed by
/// `ρv²/κ`; and a grid has a viscosity of its own, in proportion to `ρ v h`.
fn deviation(scales: &Discrepancy, parameter: &Parameter, value: f64, resolution: &Resolution) -> f64 {
    let cell = resolution.dx / resolution.diameter;
    let impact = resolution.impact;
    if parameter.map != Map::Log10 {
        return scales.share * cell * (parameter.prior[1] - parameter.prior[0]);
    }
    let decades = |error: f64| (1.0 + error).log10();
    let off = match (parameter.unit, parameter.by_compression) {
        ("Pa s", _) => {
            let own = scales.viscosity * (resolution.density * impact).sqrt() * resolution.dx;
            (scales.magnitude * cell).hypot(decades(own / value))
        }
        (_, Some(times)) => {
            (scales.magnitude * cell).hypot(decades(scales.compression * cell * times * value / impact))
        }
        ("Pa", None) => {
            let strain = 2.0 * decades(scales.strain * cell * (value / impact).sqrt());
            let stress = decades(scales.stress * cell * impact / value);
            (scales.magnitude * cell).hypot(strain).hypot(stress)
        }
        _ => scales.magnitude * cell,
    };
    off.min((parameter.prior[1] / parameter.prior[0]).log10())
}

/// One column a cause, in the coordinates of the free unknowns at `at`.
pub(crate) fn columns(
    scales: &Discrepancy,
    law: &Law,
    free: Free,
    at: &Unknowns,
    resolution: &Resolution,
) -> Vec<Vec<f64>> {
    let list = free.list(law);
    let parameters = law.parameters();
    let own = |unknown: &Unknown| match *unknown {
        Unknown::Parameter(k) => {
            let (parameter, value) = (&parameters[k], at.parameters[k]);
            let deviation = deviation(scales, parameter, value, resolution);
            match parameter.map {
                Map::Log10 => deviation,
                _ => deviation / at.slope(law, *unknown).abs(),
            }
        }
        Unknown::Velocity(_) => scales.velocity * resolution.dx / resolution.filmed / at.slope(law, *unknown).abs(),
        Unknown::Spin(_) => {
            let speed = scales.velocity * resolution.dx / resolution.filmed;
            2.0 * speed / resolution.diameter / at.slope(law, *unknown).abs()
        }
        Unknown::Friction => ROUGH,
        Unknown::Contact | Unknown::Depth(_) => 0.0,
    };
    // with all lengths grow velocities, and stresses with their squares
    let of_length = |unknown: &Unknown| match *unknown {
        Unknown::DISTANCE => resolution.length,
        Unknown::Velocity(axis) => resolution.length * at.velocity[axis] / at.slope(law, *unknown),
        Unknown::Parameter(k) if parameters[k].map == Map::Log10 && parameters[k].unit.starts_with("Pa") => {
            2.0 * resolution.length / std::f64::consts::LN_10
        }
        _ => 0.0,
    };
    let alone = (0..list.len()).map(|k| (0..list.len()).map(|i| if i == k { own(&list[k]) } else { 0.0 }).collect());
    let together = (resolution.length > 0.0).then(|| list.iter().map(of_length).collect());
    alone.chain(together).filter(|column: &Vec<f64>| column.iter().any(|x| *x != 0.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::materials;

    const SCALES: Discrepancy = Discrepancy {
        magnitude: 0.1,
        strain: 0.2,
        stress: 0.2,
        viscosity: 0.05,
        share: 0.2,
        compression: 0.1,
        velocity: 0.1,
    };

    fn own(law: &str, parameters: [f64; 2], dx: f64) -> f64 {
        let law = materials::find(law).unwrap();
        let at = Unknowns { parameters: parameters.to_vec(), ..Unknowns::default() };
        let resolution =
            Resolution { dx, diameter: 0.2, filmed: 0.5, impact: 5e3, density: 1e3, length: 0.0, one_camera: false };
        columns(&SCALES, &law, Free::Material, &at, &resolution)[0][0]
    }

    #[test]
    fn a_finer_grid_errs_less() {
        for (law, parameters) in [("neo_hookean", [1e5, 0.3]), ("newtonian", [10.0, 1e5])] {
            assert!(own(law, parameters, 0.01) < 0.6 * own(law, parameters, 0.02), "{law}");
        }
    }

    #[test]
    fn what_is_hardly_deformed_or_hardly_resists_is_hardly_known() {
        let of = |young| own("neo_hookean", [young, 0.3], 0.02);
        assert!(of(1e7) > 1.5 * of(1e5) && of(1e2) > 1.5 * of(1e5), "{} {} {}", of(1e2), of(1e5), of(1e7));
        let of = |viscosity| own("newtonian", [viscosity, 1e5], 0.02);
        assert!(of(0.1) > 3.0 * of(100.0), "{} {}", of(0.1), of(100.0));
    }

    #[test]
    fn stresses_go_with_the_square_of_a_length() {
        let law = materials::find("neo_hookean").unwrap();
        let velocity = [0.5, 0.0, -2.0];
        let at = Unknowns { velocity, parameters: vec![1e5, 0.3], ..Unknowns::default() };
        let resolution = Resolution {
            dx: 0.02,
            diameter: 0.2,
            filmed: 0.5,
            impact: 5e3,
            density: 1e3,
            length: 0.05,
            one_camera: false,
        };
        let all = columns(&SCALES, &law, Free::Both, &at, &resolution);
        let together = all.last().unwrap();
        let x = at.coordinates(&law, Free::Both);
        // five in a hundred, to first order
        approx::assert_relative_eq!(together[0], 0.05 * x[0], max_relative = 1e-12);
        approx::assert_relative_eq!(together[2], 0.05 * x[2], max_relative = 1e-12);
        approx::assert_relative_eq!(together[3], 2.0 * 0.05 / std::f64::consts::LN_10, max_relative = 1e-12);
        assert_eq!(together[4], 0.0);
    }
}
