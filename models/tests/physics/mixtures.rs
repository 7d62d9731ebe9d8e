//! Several materials in one scene, history variables, gravity as an input: against the parts, and central differences.

use std::sync::Arc;

use gradreel::{ErrorKind, Result, Tape, Tensor, Var};
use gradreel_models::physics::{Collider, Remat, Scene, Schedule, Substance, World, materials, simulate};

use crate::scene::cube;

const DX: f64 = 0.04;

/// A scene as plain numbers.
#[derive(Clone)]
struct Plain {
    positions: Vec<[f64; 3]>,
    velocity: [f64; 3],
    gravity: Vec<f64>,
    density: Vec<f64>,
    materials: Vec<(&'static str, Vec<Vec<f64>>)>,
    material_of: Option<Vec<u32>>,
    schedule: Schedule,
}

impl Plain {
    /// Snow, plasticine and rubber on top of each other in thirds of a block, none sorted.
    fn pile() -> Self {
        let positions = cube(6, DX, [0.013, 0.03, -0.021]);
        let third = |x: &[f64; 3]| ((x[0] - 0.013) / (2.0 * DX / 2.0)) as u32 % 3;
        Self {
            velocity: [0.3, -2.0, 0.1],
            gravity: vec![0.2, -9.8, -0.1],
            density: vec![900.0],
            materials: vec![
                ("snow", vec![vec![1e5], vec![0.2], vec![0.025], vec![0.0075], vec![10.0]]),
                ("von_mises", vec![vec![2e5], vec![0.3], vec![2e3]]),
                ("neo_hookean", vec![vec![3e5], vec![0.35]]),
            ],
            material_of: Some(positions.iter().map(third).collect()),
            positions,
            schedule: Schedule { frames: 3, frame_dt: 6e-3, substeps: 40 },
        }
    }

    /// Every list of numbers that a gradient may be taken of, with its name.
    fn inputs(&mut self) -> Vec<(String, &mut Vec<f64>)> {
        let mut all = vec![("gravity".to_owned(), &mut self.gravity), ("density".to_owned(), &mut self.density)];
        for (name, values) in &mut self.materials {
            let numbered = values.iter_mut().enumerate();
            all.extend(numbered.map(|(k, values)| (format!("{name} {k}"), values)));
        }
        all
    }

    /// Positions at the frames, the loss, and the gradients of positions and of all inputs.
    fn run(mut self) -> Result<(Vec<f64>, f64, Vec<Vec<f64>>)> {
        let tape = Tape::new();
        let n = self.positions.len();
        let leaf = |values: &[f64], shape: &[usize]| tape.leaf(Tensor::from_vec(values.to_vec(), shape));
        let positions = leaf(self.positions.as_flattened(), &[n, 3]);
        let leaves: Vec<Var> = self.inputs().iter().map(|(_, values)| leaf(values, &[values.len()])).collect();
        let mut rest = leaves[2..].iter().cloned();
        let materials = self.materials.iter().map(|(name, values)| Substance {
            law: materials::find(name).unwrap(),
            parameters: rest.by_ref().take(values.len()).collect(),
        });
        let scene = Scene {
            positions: positions.clone(),
            velocity: leaf(&self.velocity, &[3]),
            density: leaves[1].clone(),
            gravity: Some(leaves[0].clone()),
            friction: None,
            materials: materials.collect(),
            material_of: self.material_of.clone().map(Arc::from),
        };
        let world = World { colliders: vec![Collider::ground(0.0)], ..World::new(DX) };
        let motion = simulate(&world, &scene, self.schedule, Remat::Every(9))?;
        let weights: Vec<f64> = (0..motion.len()).map(|i| (0.3 * i as f64).sin() + 0.2).collect();
        let loss = (&motion * &tape.constant(Tensor::from_vec(weights, motion.shape()))).sum_all();
        let gradients = loss.backward()?;
        let found = std::iter::once(&positions).chain(&leaves).map(|leaf| gradients.wrt(leaf)?.to_vec());
        Ok((motion.value()?.to_vec()?, loss.item()?, found.collect::<Result<_>>()?))
    }
}

#[test]
fn gradients_of_everything_match_differences() {
    let (_, _, gradients) = Plain::pile().run().unwrap();
    let count = Plain::pile().inputs().len();
    for input in 0..count {
        let mut pile = Plain::pile();
        let (name, values) = pile.inputs().remove(input);
        for entry in 0..values.len() {
            let loss = |by: f64| {
                let mut moved = Plain::pile();
                moved.inputs()[input].1[entry] += by;
                moved.run().unwrap().1
            };
            let step = 3e-6 * values[entry].abs();
            let difference =
                (8.0 * (loss(step) - loss(-step)) - (loss(2.0 * step) - loss(-2.0 * step))) / (12.0 * step);
            let found = gradients[1 + input][entry];
            println!("{name}[{entry}]: {found:.10e} and {difference:.10e}");
            approx::assert_relative_eq!(found, difference, max_relative = 1e-4);
        }
    }
}

#[test]
fn one_value_per_particle_adds_up_to_one_for_all() {
    let (motion, _, shared) = Plain::pile().run().unwrap();
    let mut each = Plain::pile();
    let n = each.positions.len();
    each.inputs().into_iter().skip(1).for_each(|(_, values)| *values = vec![values[0]; n]);
    let of = each.material_of.clone().unwrap();
    let (same, _, gradients) = each.run().unwrap();
    assert_eq!(motion, same);
    let mut k = 2;
    for (material, (_, values)) in Plain::pile().materials.iter().enumerate() {
        for _ in values {
            k += 1;
            let sum: f64 = gradients[k].iter().sum();
            approx::assert_relative_eq!(sum, shared[k][0], max_relative = 1e-9);
            let strangers = gradients[k].iter().zip(&of).filter(|(_, of)| **of as usize != material);
            assert!(strangers.clone().count() > 0 && strangers.clone().all(|(g, _)| *g == 0.0));
        }
    }
}

#[test]
fn bodies_that_do_not_touch_move_as_if_alone() {
    let one = Plain { material_of: None, materials: vec![Plain::pile().materials[1].clone()], ..Plain::pile() };
    let mut other = Plain { materials: vec![Plain::pile().materials[2].clone()], ..one.clone() };
    // Whole cells away, so that both see the same weights.
    other.positions.iter_mut().for_each(|x| x[2] += 25.0 * DX);
    let mut both = one.clone();
    // Alternating, as they come.
    both.positions = one.positions.iter().zip(&other.positions).flat_map(|(a, b)| [*a, *b]).collect();
    both.materials = vec![one.materials[0].clone(), other.materials[0].clone()];
    both.material_of = Some((0..both.positions.len()).map(|p| (p % 2) as u32).collect());
    let alone = [one.run().unwrap().0, other.run().unwrap().0];
    let together = both.run().unwrap().0;
    for (k, x) in together.iter().enumerate() {
        let (row, axis) = (k / 3, k % 3);
        approx::assert_abs_diff_eq!(*x, alone[row % 2][row / 2 * 3 + axis], epsilon = 1e-12);
    }
}

#[test]
fn particles_without_a_material_are_refused() {
    for (list, words) in [(None, "which particle"), (Some(vec![0; 5]), "wrong length"), (Some(vec![3; 216]), "index 3")]
    {
        let error = Plain { material_of: list, ..Plain::pile() }.run().err().unwrap();
        assert_eq!(error.kind(), ErrorKind::Input);
        assert!(error.to_string().contains(words), "{error}");
    }
}
