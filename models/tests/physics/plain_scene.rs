//! A scene as plain numbers: its motion, its gradients by reverse mode, and its derivatives by forward mode.

use std::sync::Arc;

use gradreel::{DType, Device, Result, Tape, Tensor, Var};
use gradreel_models::physics::{Law, Remat, Rollout, Scene, Schedule, Substance, World, simulate};

/// All inputs of a simulation; `values` in the order of [`Rollout`].
#[derive(Debug, Clone)]
pub struct PlainScene {
    pub world: World,
    pub schedule: Schedule,
    pub laws: Vec<Law>,
    pub material_of: Option<Vec<u32>>,
    pub values: Vec<Vec<f64>>,
    pub names: Vec<&'static str>,
}

impl PlainScene {
    /// Gravity and friction are inputs, where there are any of the latter.
    pub fn new(
        world: World,
        schedule: Schedule,
        positions: &[[f64; 3]],
        velocity: &[f64],
        friction: &[f64],
        materials: &[(Law, &[f64])],
    ) -> Self {
        let mut names = vec!["positions", "velocity", "density", "gravity"];
        let mut values =
            vec![positions.as_flattened().to_vec(), velocity.to_vec(), vec![1000.0], world.gravity.to_vec()];
        if !friction.is_empty() {
            names.push("friction");
            values.push(friction.to_vec());
        }
        for (law, given) in materials {
            names.extend(law.parameters().iter().map(|parameter| parameter.name));
            values.extend(given.iter().map(|&value| vec![value]));
        }
        let laws = materials.iter().map(|(law, _)| law.clone()).collect();
        Self { world, schedule, laws, material_of: None, values, names }
    }

    /// The op.
    pub fn rollout(&self) -> Rollout {
        Rollout {
            world: self.world.clone(),
            laws: self.laws.clone(),
            material_of: self.material_of.clone().map(Arc::from),
            gravity: true,
            friction: self.names.contains(&"friction"),
            schedule: self.schedule,
            remat: None,
        }
    }

    /// An input.
    pub fn tensor(&self, index: usize, values: &[f64]) -> Tensor {
        let n = self.values[0].len() / 3;
        match index {
            0 => Tensor::from_vec(values.to_vec(), [n, 3]),
            1 if values.len() > 3 => Tensor::from_vec(values.to_vec(), [n, 3]),
            _ => Tensor::from_vec(values.to_vec(), [values.len()]),
        }
    }

    /// Positions of all frames.
    pub fn motion(&self) -> Result<Vec<f64>> {
        self.jvp(&[]).map(|(motion, _)| motion)
    }

    /// Positions of all frames, and how they change along directions; a direction has the form of `values`.
    pub fn jvp(&self, directions: &[Vec<Vec<f64>>]) -> Result<(Vec<f64>, Vec<Vec<f64>>)> {
        let tensors = |values: &[Vec<f64>]| -> Vec<Tensor> {
            values.iter().enumerate().map(|(index, values)| self.tensor(index, values)).collect()
        };
        let directions: Vec<Vec<Option<Tensor>>> =
            directions.iter().map(|direction| tensors(direction).into_iter().map(Some).collect()).collect();
        let (motion, changes) = self.rollout().jvp(&tensors(&self.values), &directions)?;
        Ok((motion.to_vec()?, changes.iter().map(Tensor::to_vec).collect::<Result<_>>()?))
    }

    /// Positions of all frames, and the gradients of their weighted sum, by reverse mode.
    pub fn vjp(&self, weights: &[f64], remat: Remat) -> Result<(Vec<f64>, Vec<Vec<f64>>)> {
        self.vjp_on(&Device::Cpu, DType::F64, weights, remat)
    }

    /// As [`PlainScene::vjp`], on a device.
    pub fn vjp_on(
        &self,
        device: &Device,
        dtype: DType,
        weights: &[f64],
        remat: Remat,
    ) -> Result<(Vec<f64>, Vec<Vec<f64>>)> {
        let tape = Tape::new();
        let there = |tensor: Tensor| tensor.cast(dtype)?.to_device(device);
        let leaf = |(index, values): (usize, &Vec<f64>)| Ok(tape.leaf(there(self.tensor(index, values))?));
        let leaves = self.values.iter().enumerate().map(leaf).collect::<Result<Vec<Var>>>()?;
        let has_friction = self.names.contains(&"friction");
        let mut rest = leaves[4 + usize::from(has_friction)..].iter().cloned();
        let scene = Scene {
            positions: leaves[0].clone(),
            velocity: leaves[1].clone(),
            density: leaves[2].clone(),
            gravity: Some(leaves[3].clone()),
            friction: has_friction.then(|| leaves[4].clone()),
            materials: self
                .laws
                .iter()
                .map(|law| Substance {
                    law: law.clone(),
                    parameters: rest.by_ref().take(law.parameters().len()).collect(),
                })
                .collect(),
            material_of: self.material_of.clone().map(Arc::from),
        };
        let motion = simulate(&self.world, &scene, self.schedule, remat)?;
        let weights = there(Tensor::from_vec(weights.to_vec(), motion.shape()))?;
        let gradients = (&motion * &tape.constant(weights)).sum_all().backward()?;
        let found = leaves.iter().map(|leaf| gradients.wrt(leaf)?.to_vec()).collect::<Result<_>>()?;
        Ok((motion.value()?.to_vec()?, found))
    }
}
