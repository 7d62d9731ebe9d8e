//! A training of the network that can be stopped and gone on with.

use std::collections::BTreeMap;
use std::path::Path;

use gradreel::io::TensorFile;
use gradreel::optim::{Adam, Clip, Ema, Load, Muon, Params, Schedule};
use gradreel::{DType, Error, ErrorKind, Key, Result, Tape, Tensor};

use super::batch::Batch;
use super::loss::loss;
use super::network::{DepthNet, DepthSizes};
use crate::layers::{Scope, initialise};

/// How the network is trained: Muon for the convolutions between the first and the last, Adam for these and for all vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plan {
    /// Rates of Muon and of Adam.
    pub rates: [f64; 2],
    /// Weight decays of both; vectors do not decay.
    pub decays: [f64; 2],
    /// Steps of a linear warm-up, steps until the rates fall, and steps in all; they fall along half a cosine.
    pub warmup: u64,
    pub hold: u64,
    pub steps: u64,
    /// Largest norm of the gradients of each optimiser.
    pub clip: f64,
    /// Decay of the running average of the weights.
    pub average: f64,
    /// Seed of the initial weights.
    pub seed: u64,
}

/// The rates at the end, as a share, and at the start.
const LAST: f64 = 0.003;
const FIRST: f64 = 0.01;
/// Ramp of the running average in steps.
const RAMP: u64 = 20;
/// Key fold of the initial weights.
const FRESH: u64 = 103;
/// Metadata key of the seed in a checkpoint.
const SEED: &str = "training.seed";

impl Plan {
    fn schedule(&self) -> Schedule {
        let falling = Schedule::cosine(self.steps.saturating_sub(self.hold).max(1), LAST);
        let held = Schedule::warmup(self.warmup, FIRST);
        held.then(self.hold.max(self.warmup), falling)
    }

    fn optimisers(&self) -> (Muon, Adam) {
        let clip = Clip::Norm(self.clip);
        let muon =
            Muon::new(self.rates[0]).with_weight_decay(self.decays[0]).with_schedule(self.schedule()).with_clip(clip);
        let adam = Adam::new(self.rates[1]).with_schedule(self.schedule()).with_clip(clip);
        let adam =
            OUTER.iter().fold(adam, |adam, layer| adam.with_weight_decay_of(format!("{layer}.weight"), self.decays[1]));
        (muon, adam)
    }
}

/// The first and the last layer.
const OUTER: [&str; 2] = ["stem", "head"];

/// Whether Muon trains a weight.
fn is_inner(path: &str, weight: &Tensor) -> bool {
    weight.dims().len() == 4 && !OUTER.iter().any(|layer| path.starts_with(layer))
}

/// The weights in training and the state of their optimisers.
pub(crate) struct Training {
    plan: Plan,
    sizes: DepthSizes,
    params: Params,
    muon: Muon,
    adam: Adam,
    average: Ema,
}

/// Result of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Step {
    /// Number of completed steps.
    pub step: u64,
    pub loss: f64,
    /// Mean absolute error of the front \[D\].
    pub front: f64,
    /// Mean IoU along parallel rays.
    pub overlap: f64,
    /// Rate of Muon.
    pub rate: f64,
    /// Norm of all gradients.
    pub gradient_norm: f64,
}

impl Training {
    /// A training from fresh weights, or from given ones.
    ///
    /// # Errors
    /// If given weights do not belong to a network of these sizes.
    pub fn new(sizes: DepthSizes, plan: Plan, given: Option<&Params>) -> Result<Self> {
        let key = Key::new(plan.seed).fold(FRESH);
        let mut params = initialise(key, DType::F32, |scope| DepthNet::new(scope, &sizes))?;
        if let Some(given) = given {
            let mut file = TensorFile::default();
            given.save(&mut file)?;
            params.load(&file, &Load::strict())?;
        }
        let (muon, adam) = plan.optimisers();
        Ok(Self { plan, sizes, params, muon, adam, average: Ema::new(plan.average).with_ramp(RAMP) })
    }

    /// Number of completed steps.
    pub fn steps(&self) -> u64 {
        self.adam.steps()
    }

    /// Number of trained numbers.
    pub fn count(&self) -> usize {
        self.params.count()
    }

    /// One step.
    ///
    /// # Errors
    /// [`ErrorKind::NonFinite`] for a gradient that is not finite; the training is unchanged then.
    pub fn step(&mut self, batch: &Batch) -> Result<Step> {
        let (values, gradients) = {
            let tape = Tape::new();
            let bound = self.params.bind(&tape);
            let net = DepthNet::new(&Scope::root(&bound), &self.sizes)?;
            let said = net.forward(&tape.constant(batch.features.clone()));
            let found = loss(&tape, &said, batch);
            let gradients = bound.gradients(&found.total.backward()?)?;
            ([found.total.item()?, found.front.item()?, found.apart.item()?], gradients)
        };
        let (inner, outer): (BTreeMap<_, _>, BTreeMap<_, _>) =
            gradients.into_iter().partition(|(path, gradient)| is_inner(path, gradient));
        if let Some((path, _)) =
            inner.iter().chain(&outer).find(|(_, gradient)| !gradient.all_finite().unwrap_or(false))
        {
            return Err(Error::new(ErrorKind::NonFinite, "the gradient of a weight is not finite").at(path));
        }
        let inner = self.muon.step(&mut self.params, &inner)?;
        let outer = self.adam.step(&mut self.params, &outer)?;
        self.average.update(&self.params)?;
        let [loss, front, apart] = values;
        let gradient_norm = inner.gradient_norm.hypot(outer.gradient_norm);
        Ok(Step { step: outer.step, loss, front, overlap: 1.0 - apart, rate: inner.rate, gradient_norm })
    }

    /// The averaged weights.
    pub fn averaged(&self) -> Params {
        match self.steps() {
            0 => self.params.clone(),
            _ => self.average.averaged(&self.params),
        }
    }

    /// Sizes of the network.
    pub fn sizes(&self) -> DepthSizes {
        self.sizes
    }

    /// Saves weights, optimisers and average; the file is replaced atomically.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let mut file = TensorFile::default();
        self.params.save(&mut file)?;
        self.muon.save(&mut file);
        self.adam.save(&mut file);
        self.average.save(&mut file);
        file.metadata.insert(SEED.to_owned(), self.plan.seed.to_string());
        file.write(path)
    }

    /// Goes on from a checkpoint, bit for bit.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a file that is not a checkpoint of this training, which leaves the training unchanged.
    pub fn resume(&mut self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let file = TensorFile::read(path)?;
        self.restore(&file).map_err(|e| e.within(path.display()))
    }

    fn restore(&mut self, file: &TensorFile) -> Result<()> {
        let seed = file.metadata.get(SEED);
        if seed.is_none_or(|seed| *seed != self.plan.seed.to_string()) {
            return Err(Error::new(ErrorKind::Input, "the checkpoint is not one of a training with this seed")
                .found(seed.map_or("no seed", |seed| seed))
                .wanted(self.plan.seed)
                .fix("go on in the folder of the training that wrote it"));
        }
        let (mut params, mut muon, mut adam) = (self.params.clone(), self.muon.clone(), self.adam.clone());
        let mut average = self.average.clone();
        params.load(file, &Load::strict())?;
        muon.restore(file)?;
        adam.restore(file)?;
        average.restore(file)?;
        (self.params, self.muon, self.adam, self.average) = (params, muon, adam, average);
        Ok(())
    }

    /// Writes the averaged weights with their sizes.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn export(&self, path: impl AsRef<Path>) -> Result<()> {
        let mut file = TensorFile::default();
        self.averaged().save(&mut file)?;
        file.metadata.insert(DepthSizes::METADATA.to_owned(), self.sizes.to_json());
        file.write(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::camera::Attitude;
    use crate::depth::sample::{Kind, Sample};
    use crate::depth::testing::boxed;

    const SIZES: DepthSizes = DepthSizes { channels: [8, 8, 16, 16], blocks: [1; 4] };

    fn plan(steps: u64) -> Plan {
        Plan { rates: [0.02, 2e-3], decays: [0.01, 0.02], warmup: 2, hold: 4, steps, clip: 5.0, average: 0.99, seed: 3 }
    }

    fn batch(number: u64) -> Batch {
        let solid = boxed([0.5, 0.2, 0.3]);
        let draw = |n| Sample::draw(&solid, Key::new(number).fold(n), Kind::Exact(Attitude::Free)).unwrap();
        Batch::of(&[draw(0), draw(1)])
    }

    fn bits(params: &Params) -> Vec<(String, Vec<u32>)> {
        params
            .iter()
            .map(|(path, x)| (path.to_owned(), x.slice::<f32>().iter().map(|x| x.to_bits()).collect()))
            .collect()
    }

    #[test]
    fn every_weight_learns() {
        let mut training = Training::new(SIZES, plan(20), None).unwrap();
        let before = training.params.clone();
        // the head is 0 at first, and passes nothing on before its first step
        for n in 0..3 {
            training.step(&batch(n)).unwrap();
        }
        for (path, weight) in training.params.iter() {
            assert_ne!(weight.slice::<f32>(), before.get(path).unwrap().slice::<f32>(), "{path} stays");
        }
        let inner = training.params.iter().filter(|(path, weight)| is_inner(path, weight)).count();
        assert_eq!(inner, 3 + 3 + 2 * 7);
    }

    #[test]
    fn one_batch_is_learnt_by_heart() {
        let mut training = Training::new(SIZES, plan(60), None).unwrap();
        let batch = batch(1);
        let losses: Vec<f64> = (0..60).map(|_| training.step(&batch).unwrap().loss).collect();
        assert!(losses[59] < losses[0] - 0.5, "{} to {}", losses[0], losses[59]);
    }

    #[test]
    fn it_goes_on_from_a_checkpoint_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("state.safetensors");
        let mut straight = Training::new(SIZES, plan(6), None).unwrap();
        let mut first = Training::new(SIZES, plan(6), None).unwrap();
        for n in 0..6 {
            straight.step(&batch(n)).unwrap();
        }
        for n in 0..3 {
            first.step(&batch(n)).unwrap();
        }
        first.save(&path).unwrap();
        let mut second = Training::new(SIZES, plan(6), None).unwrap();
        second.resume(&path).unwrap();
        assert_eq!(second.steps(), 3);
        for n in 3..6 {
            second.step(&batch(n)).unwrap();
        }
        assert_eq!(bits(&second.params), bits(&straight.params));
        assert_eq!(bits(&second.averaged()), bits(&straight.averaged()));
        let mut other = Training::new(SIZES, Plan { seed: 4, ..plan(6) }, None).unwrap();
        let error = other.resume(&path).unwrap_err();
        assert!(error.kind() == ErrorKind::Input && error.to_string().contains("seed"), "{error}");
    }

    #[test]
    fn rates_rise_stay_and_fall() {
        let plan = Plan { warmup: 100, hold: 400, steps: 1000, ..plan(0) };
        let at = |step: u64| plan.schedule().factor(step);
        assert!((at(0) - 0.01).abs() < 1e-12 && at(100) == 1.0 && at(399) == 1.0);
        assert!((at(700) - (0.003 + 0.997 * 0.5)).abs() < 1e-9 && (at(1000) - 0.003).abs() < 1e-9);
    }
}
