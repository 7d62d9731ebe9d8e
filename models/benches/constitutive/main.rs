//! Nanoseconds per particle of constitutive laws by themselves: projection and stress, and these with their derivative.
//!
//! `cargo bench -p gradreel-models --bench constitutive`. One thread, `f32`, particles in blocks of 256 that stay in the
//! cache, as inside a substep; the least of many repetitions. A third of the particles is at rest, a third moderately and a
//! third largely deformed. The last two lines are one law, traced and written by hand (`hand_written.rs`).

mod hand_written;

use std::time::Instant;

use gradreel::scalar::{Lanes, Mat3, Program, Scalar};
use gradreel_models::physics::{Law, materials};

/// Particles per call.
const BLOCK: usize = 256;
/// Blocks, whose inputs fit the second-level cache.
const BLOCKS: usize = 16;
/// Repetitions, of which the fastest counts.
const REPEAT: usize = 60;

const F: [&str; 9] = ["f00", "f01", "f02", "f10", "f11", "f12", "f20", "f21", "f22"];
const TAU: [&str; 9] = ["t00", "t01", "t02", "t10", "t11", "t12", "t20", "t21", "t22"];

fn main() {
    let filter = std::env::args().skip(1).find(|argument| !argument.starts_with('-')).unwrap_or_default();
    println!("{:<28} {:>10} {:>14}   ns per particle", gradreel::isa(), "forward", "forward + vjp");
    let laws = materials::all().into_iter().filter(|law| law.name().contains(&filter));
    for law in laws {
        let values: Vec<f32> = law.parameters().iter().map(|p| p.start as f32).collect();
        line(law.name(), timed(&of_deformation(&law), &values));
    }
    line("mooney_rivlin, traced", timed(&mooney_rivlin(), &[]));
    let mut results = vec![0.0_f32; 18 * BLOCK];
    let cotangent: [f32; 9] = std::array::from_fn(|k| 0.1 + 0.05 * k as f32);
    let deformations = deformations();
    let mut by_hand = |adjoint: bool| {
        least(|block| {
            let f: [&[f32]; 9] = std::array::from_fn(|k| &deformations[k][block * BLOCK..][..BLOCK]);
            hand_written::run(f, adjoint.then_some(&cotangent), &mut results);
        })
    };
    line("mooney_rivlin, hand-written", [by_hand(false), by_hand(true)]);
}

fn line(name: &str, [forward, both]: [f64; 2]) {
    println!("{name:<28} {forward:10.2} {both:14.2}");
}

/// The fastest of many passes over all blocks, in nanoseconds per particle.
fn least(mut run: impl FnMut(usize)) -> f64 {
    let mut least = f64::INFINITY;
    for _ in 0..REPEAT {
        let start = Instant::now();
        (0..BLOCKS).for_each(&mut run);
        least = least.min(start.elapsed().as_secs_f64());
    }
    least * 1e9 / (BLOCKS * BLOCK) as f64
}

/// Forward, and forward with the derivative with respect to everything in one program, which shares what both need.
fn timed(program: &Program, values: &[f32]) -> [f64; 2] {
    let adjoint = program.vjp();
    let inputs: Vec<&str> = adjoint.inputs().iter().map(String::as_str).collect();
    let outputs: Vec<&str> = program.outputs().iter().chain(adjoint.outputs()).map(String::as_str).collect();
    let both = Program::trace("both", &inputs, &outputs, |x| {
        [program.apply(&x[..program.inputs().len()]), adjoint.apply(x)].concat()
    });
    let deformations = deformations();
    [program, &both].map(|program| {
        let mut results = vec![vec![0.0_f32; BLOCK]; program.outputs().len()];
        let cotangents: Vec<Vec<f32>> = (0..18).map(|k| vec![0.1 + 0.05 * k as f32; BLOCK]).collect();
        least(|block| {
            let mut inputs: Vec<Lanes<'_, f32>> =
                deformations.iter().map(|f| Lanes::Each(&f[block * BLOCK..][..BLOCK])).collect();
            inputs.extend(values.iter().map(|&value| Lanes::Same(value)));
            inputs.extend(cotangents.iter().map(|g| Lanes::Each(g)).take(program.inputs().len() - inputs.len()));
            program.run(BLOCK, &inputs, &mut results.iter_mut().map(Vec::as_mut_slice).collect::<Vec<_>>());
        })
    })
}

/// `F, parameters ↦ F′, τ` of a material at rest otherwise.
fn of_deformation(law: &Law) -> Program {
    let inputs: Vec<&str> = F.into_iter().chain(law.parameters().iter().map(|p| p.name)).collect();
    let outputs: Vec<&str> = law.program().outputs()[..18].iter().map(String::as_str).collect();
    // An elastic law hands its deformation through, which is no work.
    let stretch = [2.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.1];
    let values = law.parameters().iter().map(|p| p.start).chain(law.history().iter().map(|h| h.start));
    let inputs_there: Vec<f64> = stretch.into_iter().chain([0.0; 9]).chain([1e-4]).chain(values).collect();
    let first = if law.program().eval(&inputs_there)[..9] == stretch { 9 } else { 0 };
    Program::trace(law.name(), &inputs, &outputs[first..], |x| {
        let known = |value: f64| Scalar::from(value);
        let mut all = x[..9].to_vec();
        all.extend([0.0; 9].map(known));
        all.push(known(1e-4));
        all.extend(&x[9..]);
        all.extend(law.history().iter().map(|variable| known(variable.start)));
        law.program().apply(&all)[first..18].to_vec()
    })
}

/// Compressible Mooney–Rivlin rubber, as a user would write it: `τ = 2 dev[(c₁ + c₂ Ī₁) b̄ − c₂ b̄²] + K J (J − 1) I`.
fn mooney_rivlin() -> Program {
    let [c1, c2, bulk] = hand_written::PARAMETERS.map(f64::from);
    Program::trace("mooney_rivlin", &F, &TAU, |x| {
        let f = Mat3::from_slice(x);
        let j = f.det();
        let b = (f * f.t()) * (j.ln() * (-2.0 / 3.0)).exp();
        let distortion = b * (c1 + c2 * b.trace()) - (b * b) * c2;
        (distortion.dev() * 2.0 + Mat3::eye() * (bulk * j * (j - 1.0))).to_vec()
    })
}

fn deformations() -> Vec<Vec<f32>> {
    let value = |p: usize, k: usize| {
        let size = [0.0, 0.02, 0.2][p % 3];
        let rest = if k.is_multiple_of(4) { 1.0 } else { 0.0 };
        (rest + size * (1.7 * p as f64 + 2.3 * k as f64 + 0.01 * (p * k) as f64).sin()) as f32
    };
    (0..9).map(|k| (0..BLOCKS * BLOCK).map(|p| value(p, k)).collect()).collect()
}
