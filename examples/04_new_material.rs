//! A material of one's own in one file: its stress, written for one particle. Derivative, checks and speed follow.
//!
//! Compressible Mooney–Rivlin rubber: energy per rest volume `c₁ (Ī₁ − 3) + c₂ (Ī₂ − 3) + K/2 (J − 1)²` with the
//! invariants of `b̄ = J^(−2/3) F Fᵀ`, hence the Kirchhoff stress
//! `τ = 2 dev[(c₁ + c₂ Ī₁) b̄ − c₂ b̄²] + K J (J − 1) I`. It is put through the battery of checks, then dropped on the ground.
//!
//! ```text
//! cargo run --release --example 04_new_material
//! ```

use gradreel::{Result, Tape, Tensor, scalar::Mat3};
use gradreel_models::physics::{
    Body, CFL, Collider, Contact, Given, Law, Material, Parameter, Point, Remat, Schedule, World, check_material,
    rollout,
};

#[derive(Debug)]
struct MooneyRivlin;

impl Material for MooneyRivlin {
    fn name(&self) -> &str {
        "mooney_rivlin"
    }

    fn parameters(&self) -> Vec<Parameter> {
        vec![
            Parameter::log10("c1", "c₁", "Pa", [1e3, 1e6]),
            Parameter::log10("c2", "c₂", "Pa", [1e2, 1e5]),
            Parameter::log10("bulk", "K", "Pa", [1e4, 1e7]),
        ]
    }

    fn stress(&self, point: &Point, given: &Given) -> Mat3 {
        let (c1, c2, bulk) = (given["c1"], given["c2"], given["bulk"]);
        let j = point.f.det();
        let b = (point.f * point.f.t()) * j.powf(-2.0 / 3.0);
        let distortion = b * (c1 + c2 * b.trace()) - (b * b) * c2;
        distortion.dev() * 2.0 + Mat3::eye() * (bulk * j * (j - 1.0))
    }

    /// Pressure waves: `√((K + 4/3 μ)/ρ)` with the shear modulus at rest `μ = 2 (c₁ + c₂)`.
    fn wave_speed(&self, values: &[f64], density: f64) -> f64 {
        ((values[2] + 8.0 / 3.0 * (values[0] + values[1])) / density).sqrt()
    }

    /// `J^(−2/3)` is NaN for inverted material, which a rollout reports.
    fn survives_inversion(&self) -> bool {
        false
    }
}

fn main() -> Result<()> {
    let law = Law::of(MooneyRivlin);
    let report = check_material(&law)?;
    println!("{report}");
    assert!(report.passed());

    // A block of 6 × 6 × 6 particles, 10 cm above the ground, falling at 1 m/s.
    let ground = Collider::plane([0.0; 3], [0.0, 1.0, 0.0], Contact::Separate);
    let world = World { colliders: vec![ground], ..World::new(0.02) };
    let (values, density, fall, frame_dt) = ([2e4, 5e3, 2e5], 1000.0, 1.0, 1.0 / 60.0);
    let schedule = Schedule::stable(&world, 13, frame_dt, law.wave_speed(&values, density), 2.0, CFL);
    let block = (0..216).flat_map(|i| [i / 36, 10 + i / 6 % 6, i % 6].map(|k| 0.01 * f64::from(k)));

    let tape = Tape::new();
    let number = |value: f64| tape.constant(Tensor::from_vec(vec![value], [1]));
    let body = Body {
        positions: tape.constant(Tensor::from_vec(block.collect(), [216, 3])),
        velocity: tape.constant(Tensor::from_vec(vec![0.0, -fall, 0.0], [3])),
        density: number(density),
        parameters: values.map(number).to_vec(),
    };
    let motion = rollout(&world, &law, schedule, Remat::default(), &body)?;
    let heights = motion.select(2, 1).mean(&[1]).value()?.to_vec()?;
    for (frame, height) in heights.iter().enumerate() {
        println!("frame {frame:2}  {height:.4} m {}■", " ".repeat((300.0 * height) as usize));
    }
    // Until it touches the ground, gravity alone changes its momentum: v ← v + g dt, x ← x + v dt.
    let t = 3.0 * frame_dt;
    assert!((heights[3] - (heights[0] - fall * t - 4.9 * t * (t + schedule.dt()))).abs() < 1e-9);
    // It is stopped, and thrown back.
    let lowest = heights.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(heights[12] > lowest + 0.01, "a bounce: {heights:?}");
    Ok(())
}
