//! Rollouts on a tape.

use gradreel::{Result, Tape, Tensor, Var};
use gradreel_models::physics::{Body, Collider, Law, Remat, Schedule, World, materials::NeoHookean, rollout};

use crate::scene::cube;

/// A small block that hits the ground within a few frames; everything that a gradient may be taken of.
#[derive(Debug, Clone)]
pub struct Drop {
    pub world: World,
    pub law: Law,
    pub schedule: Schedule,
    pub positions: Vec<f64>,
    pub velocity: Vec<f64>,
    pub density: Vec<f64>,
    pub young: Vec<f64>,
    pub poisson: Vec<f64>,
}

impl Drop {
    pub fn new(side: usize) -> Self {
        let dx = 0.04;
        Self {
            world: World { colliders: vec![Collider::ground(0.0)], ..World::new(dx) },
            law: Law::of(NeoHookean),
            schedule: Schedule { frames: 4, frame_dt: 6e-3, substeps: 24 },
            positions: cube(side, dx, [0.013, 0.047, -0.021]).into_flattened(),
            velocity: vec![0.3, -2.0, 0.1],
            density: vec![1000.0],
            young: vec![2e5],
            poisson: vec![0.3],
        }
    }

    /// The five inputs, in order.
    pub fn inputs(&mut self) -> [&mut Vec<f64>; 5] {
        [&mut self.positions, &mut self.velocity, &mut self.density, &mut self.young, &mut self.poisson]
    }

    /// The loss (weighted positions of all frames), the motion, and the gradients of the five inputs.
    pub fn run(self, remat: Remat, single: bool) -> Result<(f64, Vec<f64>, Vec<Vec<f64>>)> {
        self.run_weighted(remat, single, |i| (0.3 * i as f64).sin() + 0.2)
    }

    /// As [`Drop::run`], with a weight for each coordinate.
    pub fn run_weighted(
        mut self,
        remat: Remat,
        single: bool,
        weight: impl Fn(usize) -> f64,
    ) -> Result<(f64, Vec<f64>, Vec<Vec<f64>>)> {
        let tape = Tape::new();
        let n = self.positions.len() / 3;
        let leaves: Vec<Var> = self
            .inputs()
            .into_iter()
            .enumerate()
            .map(|(index, values)| {
                let shape =
                    if index == 0 || (index == 1 && values.len() > 3) { vec![n, 3] } else { vec![values.len()] };
                let shape: &[usize] = &shape;
                tape.leaf(match single {
                    true => Tensor::from_vec(values.iter().map(|&x| x as f32).collect(), shape),
                    false => Tensor::from_vec(values.clone(), shape),
                })
            })
            .collect();
        let body = Body {
            positions: leaves[0].clone(),
            velocity: leaves[1].clone(),
            density: leaves[2].clone(),
            parameters: leaves[3..].to_vec(),
        };
        let motion = rollout(&self.world, &self.law, self.schedule, remat, &body)?;
        let weights = (0..motion.len()).map(weight).collect();
        let weights = Tensor::from_vec::<f64>(weights, motion.shape()).cast(motion.dtype())?;
        let loss = (&motion * &tape.constant(weights)).sum_all();
        let gradients = loss.backward()?;
        let gradients = leaves.iter().map(|leaf| gradients.wrt(leaf)?.to_vec()).collect::<Result<Vec<_>>>()?;
        Ok((loss.item()?, motion.value()?.to_vec()?, gradients))
    }
}
