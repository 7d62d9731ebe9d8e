//! The denoiser with as many concurrent views as memory allows.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc;
use std::thread;

use gradreel::{Device, Error, ErrorKind, Result, Shape, Tape, Tensor, Var};
use rayon::{ThreadPool, ThreadPoolBuilder};

use super::denoiser::Sight;
use super::{Condition, Denoiser, DenoiserSizes, Look, Moment, Output, Predictor, Subject, Target, on_cpu};
use crate::layers::{Init, Scope, Weights};

/// The multi-view denoiser as a `Predictor`.
///
/// On the CPU every view is evaluated separately, so that its result is bitwise independent of the number of
/// concurrent views, each of which runs on a share of the threads. Concurrent views use the CPU better than one
/// view alone if the networks are small. They share the weights without copying. On a GPU concurrent views form one
/// batch.
///
/// No gradients are recorded.
pub struct Ensemble {
    sizes: DenoiserSizes,
    device: Device,
    at_once: usize,
    /// The denoiser of the calling thread.
    denoiser: Denoiser,
    weights: BTreeMap<String, Tensor>,
    /// Thread pool per view, if several run concurrently.
    teams: Vec<ThreadPool>,
}

impl Ensemble {
    /// Builds the denoiser with `at_once` concurrent views (see [`super::MemoryEstimate::at_once`]).
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape, or threads cannot be started.
    pub fn new(weights: &dyn Weights, sizes: &DenoiserSizes, device: &Device, at_once: usize) -> Result<Self> {
        let at_once = at_once.clamp(1, sizes.ring.views);
        let kept = Keeper { from: weights, kept: RefCell::default() };
        let denoiser = Denoiser::new(&Scope::root(&kept), sizes)?;
        let teams = if *device == Device::Cpu && at_once > 1 { teams(at_once)? } else { Vec::new() };
        let weights = kept.kept.into_inner();
        Ok(Self { sizes: sizes.clone(), device: device.clone(), at_once, denoiser, weights, teams })
    }

    /// Number of concurrent views.
    pub fn at_once(&self) -> usize {
        self.at_once
    }

    /// The denoiser, for other uses.
    pub fn denoiser(&self) -> &Denoiser {
        &self.denoiser
    }

    /// Evaluates groups of views as batches on this thread.
    fn by_batches(
        &self,
        (look, condition): (&Look, &Condition),
        views: &[usize],
        size: usize,
        guidance: f64,
        found: &mut dyn FnMut(usize, Tensor) -> Result<()>,
    ) -> Result<()> {
        for group in views.chunks(size) {
            let targets: Vec<Target> = group.iter().map(|&view| Target { sample: 0, view }).collect();
            let noise = self.denoiser.noise(look, condition, &targets, guidance)?;
            for (place, &view) in group.iter().enumerate() {
                found(view, on_cpu(&noise.slice(0, place..place + 1))?)?;
            }
        }
        Ok(())
    }

    /// Evaluates views concurrently, each on its own thread pool.
    fn by_teams(
        &self,
        look: &Look,
        moment: &Moment<'_>,
        views: &[usize],
        found: &mut dyn FnMut(usize, Tensor) -> Result<()>,
    ) -> Result<()> {
        let (next, stop) = (AtomicUsize::new(0), AtomicBool::new(false));
        let (sender, receiver) = mpsc::channel();
        let job = Job {
            sizes: &self.sizes,
            weights: &self.weights,
            sight: look.sight()?,
            subject: moment.subject,
            guidance: moment.guidance,
        };
        thread::scope(|scope| {
            for team in &self.teams {
                let (job, next, stop, sender) = (&job, &next, &stop, sender.clone());
                scope.spawn(move || {
                    team.install(move || {
                        let mut worker = None;
                        while !stop.load(Ordering::Relaxed) {
                            let Some(&view) = views.get(next.fetch_add(1, Ordering::Relaxed)) else { break };
                            let noise = job.noise(&mut worker, view);
                            // the receiver outlives all teams
                            let _ = sender.send((view, noise));
                        }
                    });
                });
            }
            drop(sender);
            let mut outcome = Ok(());
            for (view, noise) in receiver {
                // views finished after a fault are delivered nevertheless, so that their work is not lost
                if let Err(error) = noise.and_then(|noise| found(view, noise))
                    && outcome.is_ok()
                {
                    outcome = Err(error);
                    stop.store(true, Ordering::Relaxed);
                }
            }
            outcome
        })
    }
}

impl Predictor for Ensemble {
    fn ends_clean(&self) -> bool {
        self.sizes.output == Output::Clean
    }

    fn predict(
        &self,
        moment: &Moment<'_>,
        views: &[usize],
        found: &mut dyn FnMut(usize, Tensor) -> Result<()>,
    ) -> Result<()> {
        let tape = Tape::new();
        let condition = moment.subject.condition(&tape, &self.device)?;
        let latents = tape.constant(moment.latents.to_device(&self.device)?);
        let look = self.denoiser.look(&latents, &[moment.time], &condition)?;
        let size = if self.device == Device::Cpu { 1 } else { self.at_once };
        if self.teams.is_empty() || views.len() < 2 {
            self.by_batches((&look, &condition), views, size, moment.guidance, found)
        } else {
            self.by_teams(&look, moment, views, found)
        }
    }
}

/// Data shared by the teams.
struct Job<'a> {
    sizes: &'a DenoiserSizes,
    weights: &'a BTreeMap<String, Tensor>,
    sight: Sight,
    subject: &'a Subject,
    guidance: f64,
}

impl Job<'_> {
    /// The noise in one view; `worker` caches what a team builds for its first view.
    fn noise(&self, worker: &mut Option<(Denoiser, Look, Condition)>, view: usize) -> Result<Tensor> {
        let (denoiser, look, condition) = match worker {
            Some(made) => made,
            None => {
                let tape = Tape::new();
                let source = Shared { tape: tape.clone(), weights: self.weights };
                let denoiser = Denoiser::new(&Scope::root(&source), self.sizes)?;
                let condition = self.subject.condition(&tape, &Device::Cpu)?;
                worker.insert((denoiser, Look::of(&tape, &self.sight), condition))
            }
        };
        on_cpu(&denoiser.noise(look, condition, &[Target { sample: 0, view }], self.guidance)?)
    }
}

/// One thread pool per concurrent view: equal shares of the calling pool's threads.
fn teams(count: usize) -> Result<Vec<ThreadPool>> {
    let threads = (rayon::current_num_threads() / count).max(1);
    let team = |_| ThreadPoolBuilder::new().num_threads(threads).build();
    let teams: Result<_, _> = (0..count).map(team).collect();
    teams.map_err(|e| Error::new(ErrorKind::Io, "cannot start threads").found(e).fix("lower the memory budget"))
}

/// Caches every weight that a network requests, without gradient.
struct Keeper<'a> {
    from: &'a dyn Weights,
    kept: RefCell<BTreeMap<String, Tensor>>,
}

impl Weights for Keeper<'_> {
    fn weight(&self, path: &str, shape: &Shape, init: Init) -> Result<Var> {
        let weight = self.from.weight(path, shape, init)?.detach();
        self.kept.borrow_mut().insert(path.to_owned(), weight.value()?.clone());
        Ok(weight)
    }
}

/// The cached weights as constants of another tape.
struct Shared<'a> {
    tape: Tape,
    weights: &'a BTreeMap<String, Tensor>,
}

impl Weights for Shared<'_> {
    fn weight(&self, path: &str, _: &Shape, _: Init) -> Result<Var> {
        Ok(self.tape.constant(self.weights[path].clone()))
    }
}
