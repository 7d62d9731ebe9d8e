//! The image loss as least squares: residuals of all pixels, and how they change with the unknowns.

use std::ops::Range;

use gradreel::{DType, Result, Tape, Tensor};
use rayon::prelude::*;

use crate::identify::model::flight::displacement;
use crate::identify::model::penalty::add_penalty;
use crate::identify::model::problem::is_stress;
use crate::identify::model::shutter::{Beside, beside, mean};
use crate::identify::model::spin::Gyration;
use crate::identify::model::unknowns::Unknown;
use crate::identify::uncertainty::prior::Prior;
use crate::identify::{Free, Problem, Substeps, Unknowns};
use crate::physics::{Rollout, Schedule};
use crate::render::trajectory::Middle;
use crate::render::{Splat, render_jvp};
use crate::vector::{plus, times};

/// The loss around a point, to second order in the sense of Gauss and Newton.
///
/// With the residuals `r = rendered − filmed` of all pixels and channels, their weights `w` and their Jacobian `J` in the
/// coordinates of the free unknowns, over `m` frames: loss `Σ w r²/m`, gradient `2 Jᵀ w r/m`, curvature `2 Jᵀ w J/m`. A residual
/// beyond the `δ` of a robust pixel counts `2 δ |r| − δ²` and has `w δ/|r|` for its weight in the derivatives (iteratively
/// reweighted least squares). Middles of a trajectory are two more residuals of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Linearised {
    /// The loss.
    pub loss: f64,
    /// Its gradient.
    pub gradient: Vec<f64>,
    /// Its curvature as Gauss and Newton see it, row by row.
    pub curvature: Vec<Vec<f64>>,
}

impl Linearised {
    fn zero(unknowns: usize) -> Self {
        let (gradient, curvature) = (vec![0.0; unknowns], vec![vec![0.0; unknowns]; unknowns]);
        Self { loss: 0.0, gradient, curvature }
    }

    /// Adds one picture: rendered and filmed values and weights of its pixels `[rays, 4]`, and the changes of the rendered
    /// ones `[rays, unknowns, 4]`.
    fn add_picture<T: gradreel::scalar::Real>(
        &mut self,
        [pixels, filmed, weight, changes]: [&[T]; 4],
        share: f64,
        robust: Option<f64>,
    ) {
        let unknowns = self.gradient.len();
        let mut row = vec![0.0; unknowns];
        for r in 0..pixels.len() / 4 {
            let changes = &changes[r * 4 * unknowns..][..4 * unknowns];
            let moves = changes.iter().any(|&c| c != T::ZERO);
            for c in 0..4 {
                let mut w = weight[4 * r + c].to_f64() * share;
                let residual = pixels[4 * r + c].to_f64() - filmed[4 * r + c].to_f64();
                match robust.filter(|delta| residual.abs() > *delta) {
                    None => self.loss += w * residual * residual,
                    Some(delta) => {
                        self.loss += w * delta * (2.0 * residual.abs() - delta);
                        w *= delta / residual.abs();
                    }
                }
                if !moves || w == 0.0 {
                    continue;
                }
                for k in 0..unknowns {
                    row[k] = changes[4 * k + c].to_f64();
                }
                self.add_derivatives(w, residual, &row);
            }
        }
    }

    /// Adds the object's middle in a picture.
    fn add_middle(&mut self, middle: &Middle, share: f64) {
        let w = middle.weight * share;
        for (residual, changes) in middle.residual.iter().zip(&middle.changes) {
            self.loss += w * residual * residual;
            self.add_derivatives(w, *residual, changes);
        }
    }

    /// Adds what a residual of weight `w` has in gradient and curvature, from how it changes with each unknown.
    #[inline(always)]
    fn add_derivatives(&mut self, w: f64, residual: f64, changes: &[f64]) {
        for k in 0..changes.len() {
            self.gradient[k] += 2.0 * w * residual * changes[k];
            for l in 0..=k {
                self.curvature[k][l] += 2.0 * w * changes[k] * changes[l];
            }
        }
    }

    /// Completes the curvature from its lower triangle.
    fn mirror(&mut self) {
        for k in 0..self.curvature.len() {
            for l in 0..k {
                self.curvature[l][k] = self.curvature[k][l];
            }
        }
    }

    /// Adds a share of other sums.
    fn add_share(&mut self, part: &Self, share: f64) {
        self.loss += share * part.loss;
        let matrices = self.curvature.iter_mut().zip(&part.curvature);
        matrices.for_each(|(sum, part)| sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += share * part));
        self.gradient.iter_mut().zip(&part.gradient).for_each(|(sum, part)| *sum += share * part);
    }

    /// The mean of `ln(L + floor)` over frames with the losses `L`, and its derivatives: what is proportional to the logarithm of the
    /// likelihood where each frame has an unknown deviation of its own that is not below that of `floor`.
    ///
    /// How far a model is off grows with the time since the contact, and differs from frame to frame: a frame counts by how well it
    /// can be explained.
    pub(in crate::identify) fn mean_log(frames: &[Self], floor: f64) -> Self {
        let count = frames.first().map_or(0, |frame| frame.gradient.len());
        let mut total = Self::zero(count);
        for frame in frames {
            let variance = (frame.loss + floor).max(f64::MIN_POSITIVE);
            total.add_share(frame, 1.0 / (variance * frames.len() as f64));
        }
        total.loss = frames.iter().map(|frame| (frame.loss + floor).max(f64::MIN_POSITIVE).ln()).sum::<f64>()
            / frames.len().max(1) as f64;
        total
    }
}

impl Problem<'_> {
    /// The loss of the first `frames` frames, averaged over them, without derivatives.
    ///
    /// # Errors
    /// As [`Problem::evaluate`].
    pub fn misfit(&self, unknowns: &Unknowns, frames: usize, substeps: &mut Substeps) -> Result<f64> {
        self.linearise(unknowns, Free::NOTHING, frames, substeps).map(|at| at.loss)
    }

    /// The loss of the first `frames` frames, averaged over them, with its derivatives along the free unknowns.
    ///
    /// All tangents are carried through one rollout and one rendering of each frame; normal equations are summed picture by
    /// picture, so that the Jacobian is never in memory as a whole. `substeps` as in [`Problem::with_step`].
    ///
    /// # Errors
    /// As [`Problem::evaluate`]; [`gradreel::ErrorKind::NonFinite`] when a tangent becomes infinite.
    pub fn linearise(
        &self,
        unknowns: &Unknowns,
        free: Free,
        frames: usize,
        substeps: &mut Substeps,
    ) -> Result<Linearised> {
        let each = self.linearise_frames(unknowns, free, 0..frames, Derivatives::Exact, substeps)?;
        let mut total = Linearised::zero(free.list(&self.law).len());
        let share = 1.0 / each.len().max(1) as f64;
        each.iter().for_each(|frame| total.add_share(frame, share));
        if let Some(ranges) = &self.ranges {
            let penalty = ranges.derivatives(&self.law, unknowns, free);
            total.loss += add_penalty(penalty, &mut total.gradient, &mut total.curvature);
        }
        Ok(total)
    }

    /// The loss of each of these frames with its derivatives along the free unknowns.
    ///
    /// # Errors
    /// As [`Problem::linearise`].
    pub(in crate::identify) fn linearise_frames(
        &self,
        unknowns: &Unknowns,
        free: Free,
        frames: Range<usize>,
        derivatives: Derivatives,
        substeps: &mut Substeps,
    ) -> Result<Vec<Linearised>> {
        let frames = frames.start..frames.end.min(self.observed.targets.len());
        let derivatives = if self.flying { Derivatives::Exact } else { derivatives };
        let moved = self.with_step(unknowns, frames.end, substeps, &mut |schedule| match derivatives {
            Derivatives::Exact => {
                let (motion, tangents) = self.tangents(unknowns, free, schedule)?;
                Ok(Moved { motion, along: Along::Tangents(tangents) })
            }
            Derivatives::Ahead(share) => self.beside(unknowns, free, schedule, share),
        })?;
        let count = free.list(&self.law).len();
        let looks = [self.particles.opacity(self.dtype)?, self.particles.colour(self.dtype)?];
        let of = |frame: usize| {
            let mut total = Linearised::zero(count);
            self.add_frame(&mut total, &moved, &looks, frame, 1.0)?;
            total.mirror();
            Ok(total)
        };
        frames.map(of).collect()
    }

    /// The loss of every frame of a motion.
    ///
    /// # Errors
    /// What the renderer returns.
    pub(in crate::identify) fn losses_of(&self, motion: &Tensor) -> Result<Vec<f64>> {
        let moved = Moved { motion: motion.clone(), along: Along::Tangents(Vec::new()) };
        let looks = [self.particles.opacity(self.dtype)?, self.particles.colour(self.dtype)?];
        let of = |frame: usize| {
            let mut total = Linearised::zero(0);
            self.add_frame(&mut total, &moved, &looks, frame, 1.0)?;
            Ok(total.loss)
        };
        (0..motion.dims()[0]).map(of).collect()
    }

    /// Adds the pictures of one frame to sums of which only the lower triangle of the curvature is kept.
    fn add_frame(
        &self,
        total: &mut Linearised,
        moved: &Moved,
        looks: &[Tensor; 2],
        frame: usize,
        share: f64,
    ) -> Result<()> {
        let count = total.gradient.len();
        let drawn = self.drawn(moved, looks, frame)?;
        let parts = match self.dtype {
            DType::F64 => self.pictures::<f64>(frame, &drawn, count, share),
            _ => self.pictures::<f32>(frame, &drawn, count, share),
        };
        parts.iter().for_each(|part| total.add_share(part, 1.0));
        Ok(())
    }

    /// The sums of every camera's picture of one frame.
    fn pictures<T: gradreel::scalar::Real>(
        &self,
        frame: usize,
        (pixels, changes): &(Tensor, Tensor),
        unknowns: usize,
        share: f64,
    ) -> Vec<Linearised> {
        let target = &self.observed.targets[frame];
        let values: [&[T]; 3] = [pixels.slice(), target.rgba.slice(), target.weight.slice()];
        let changes = changes.slice::<T>();
        let mut first = 0;
        let ranges = self.observed.views.iter().map(|rays| {
            first += rays;
            first - rays..first
        });
        let ranges: Vec<std::ops::Range<usize>> = ranges.collect();
        let picture = |(view, rays): (usize, &std::ops::Range<usize>)| {
            let robust = target.robust.as_ref().filter(|robust| robust.rays.slice::<T>()[rays.start] > T::ZERO);
            let mut sums = Linearised::zero(unknowns);
            let [pixels, filmed, weight] = values.map(|values| &values[4 * rays.start..4 * rays.end]);
            let changes = &changes[4 * unknowns * rays.start..4 * unknowns * rays.end];
            sums.add_picture([pixels, filmed, weight, changes], share, robust.map(|robust| robust.delta));
            let middle = target.trajectory.as_ref().and_then(|trajectory| trajectory.middle(view, pixels, changes));
            if let Some(middle) = middle {
                sums.add_middle(&middle, share);
            }
            sums
        };
        ranges.par_iter().enumerate().map(picture).collect()
    }

    /// Positions at every frame `[frames, particles, 3]` \[m\], and their tangents along the free unknowns' coordinates.
    ///
    /// The same motion as [`Problem::motion`].
    ///
    /// # Errors
    /// As [`Rollout::jvp`].
    pub fn tangents(&self, unknowns: &Unknowns, free: Free, schedule: Schedule) -> Result<(Tensor, Vec<Tensor>)> {
        let (motion, tangents) = self.tangents_in_world(unknowns, free, schedule)?;
        let list = free.list(&self.law);
        let Some(sight) = self.observed.sight.filter(|_| unknowns.depth[3] != 0.0 || free.pitch()) else {
            return Ok((motion, tangents));
        };
        let stand = sight.pitch(unknowns.depth, self.ground);
        let (by, from) = stand.seen();
        let mapped = |points: &Tensor, of: &dyn Fn(usize, [f64; 3]) -> [f64; 3]| {
            let values = points.to_vec()?;
            let each = values.as_chunks::<3>().0.iter().enumerate();
            let values: Vec<f64> = each.flat_map(|(i, x)| of(i, *x)).collect();
            Tensor::from_vec(values, points.dims()).cast(self.dtype)
        };
        let seen = mapped(&motion, &|_, x| plus(times(&by, x), from))?;
        let points = seen.to_vec()?;
        let points = points.as_chunks::<3>().0;
        let turned = |(tangent, unknown): (&Tensor, &Unknown)| {
            mapped(tangent, &|i, x| match *unknown {
                Unknown::PITCH => plus(times(&by, x), stand.seen_rate(points[i])),
                _ => times(&by, x),
            })
        };
        let tangents = tangents.iter().zip(&list).map(turned).collect::<Result<_>>()?;
        Ok((seen, tangents))
    }

    fn tangents_in_world(&self, unknowns: &Unknowns, free: Free, schedule: Schedule) -> Result<(Tensor, Vec<Tensor>)> {
        if self.flying {
            return self.flight_tangents(unknowns, free, schedule);
        }
        let opacity = &self.particles.opacity;
        let tensor = |values: Vec<f64>| {
            let len = values.len();
            Tensor::from_vec(values, [len]).cast(self.dtype)
        };
        let parameters = self.law.parameters();
        let spread = |k: usize, value: f64| {
            tensor(if is_stress(&parameters[k]) { opacity.iter().map(|o| o * value).collect() } else { vec![value] })
        };
        let list = free.list(&self.law);
        let spins = unknowns.spins() || list.iter().any(|unknown| matches!(unknown, Unknown::Spin(_)));
        let field = spins.then(|| self.spin_field(unknowns.depth)?.to_vec()).transpose()?;
        // of each particle if the body turns, `[3]` if all are alike
        let velocity = |common: [f64; 3], spin: [f64; 3]| -> Result<Tensor> {
            let Some(field) = &field else { return tensor(common.to_vec()) };
            let turning = |i: usize| (0..3).map(|axis| spin[axis] * field[axis * 3 * opacity.len() + i]).sum::<f64>();
            let values = (0..3 * opacity.len()).map(|i| common[i % 3] + turning(i)).collect();
            Tensor::from_vec(values, [opacity.len(), 3]).cast(self.dtype)
        };
        let fall = self.free_fall(unknowns, spins, schedule);
        let falling = match fall {
            0 => None,
            _ => Some(self.flight_tangents(unknowns, free, Schedule { frames: fall + 1, ..schedule })?),
        };
        let begin = match &falling {
            None => self.placed(unknowns.contact, unknowns.depth)?,
            Some((motion, _)) => raised(row(motion, fall), -unknowns.contact * self.world.dx),
        };
        // half a substep before the simulation begins
        let early = fall as f64 * schedule.frame_dt - 0.5 * schedule.dt();
        let early = std::array::from_fn(|k| unknowns.velocity[k] + early * self.world.gravity[k]);
        let density = tensor(opacity.iter().map(|o| o * self.density).collect())?;
        let mut inputs = vec![begin, velocity(early, unknowns.spin)?, density];
        let rough = self.has_friction();
        if rough {
            inputs.push(tensor(vec![unknowns.friction])?);
        }
        let first = inputs.len();
        for (k, &value) in unknowns.parameters.iter().enumerate() {
            inputs.push(spread(k, value)?);
        }
        let mut directions = Vec::new();
        for (i, &unknown) in list.iter().enumerate() {
            let slope = unknowns.slope(&self.law, unknown);
            let along = |axis: usize| std::array::from_fn(|k| if k == axis { slope } else { 0.0 });
            let mut direction = vec![None; inputs.len()];
            match unknown {
                Unknown::Velocity(axis) => {
                    direction[0] = falling.as_ref().map(|(_, tangents)| row(&tangents[i], fall));
                    direction[1] = Some(velocity(along(axis), [0.0; 3])?);
                }
                Unknown::Spin(axis) => direction[1] = Some(velocity([0.0; 3], along(axis))?),
                Unknown::Parameter(k) => direction[first + k] = Some(spread(k, slope)?),
                Unknown::Contact => {
                    let lower = [0.0, -slope * self.world.dx, 0.0].repeat(opacity.len());
                    direction[0] = Some(Tensor::from_vec(lower, [opacity.len(), 3]).cast(self.dtype)?);
                }
                // what is free without a ground that has friction moves nothing
                Unknown::Friction if rough => direction[3] = Some(tensor(vec![slope])?),
                Unknown::Friction => {}
                Unknown::Depth(axis) => direction[0] = Some(self.depth_field(axis, unknowns.depth)?),
            }
            directions.push(direction);
        }
        let after = Schedule { frames: schedule.frames - fall, ..schedule };
        let rollout = Rollout { friction: rough, ..Rollout::of_one(&self.world, &self.law, after) };
        let (motion, mut tangents) = rollout.jvp(&inputs, &directions)?;
        // back up by as much as the simulation has the body lower
        let motion = raised(motion, unknowns.contact * self.world.dx);
        for (tangent, unknown) in tangents.iter_mut().zip(list) {
            if unknown == Unknown::Contact {
                *tangent = raised(tangent.clone(), unknowns.slope(&self.law, unknown) * self.world.dx);
            }
        }
        let Some((before, moved_before)) = falling else { return Ok((motion, tangents)) };
        let tape = Tape::new();
        let whole = |(before, after): (Tensor, Tensor)| {
            let before = tape.constant(before).slice(0, 0..fall);
            Ok(before.concat(&[&tape.constant(after)], 0).value()?.clone())
        };
        let tangents = moved_before.into_iter().zip(tangents).map(whole).collect::<Result<_>>()?;
        let motion = whole((before, motion))?;
        Ok((motion, tangents))
    }

    /// Positions at every frame, and what they are with each free unknown's coordinate moved by a share of the longest step of a search
    /// towards the middle of its prior, each with the substep that it needs, as the losses that are compared have.
    fn beside(&self, unknowns: &Unknowns, free: Free, schedule: Schedule, share: f64) -> Result<Moved> {
        let here = unknowns.coordinates(&self.law, free);
        let prior = Prior::of(&self.law, free, unknowns, None);
        let far = |((longest, middle), here): ((f64, &f64), &f64)| (share * longest).copysign(middle - here);
        let lengths: Vec<f64> = prior.longest_step(unknowns).into_iter().zip(&prior.mean).zip(&here).map(far).collect();
        // in proportion to those here, which are more than what is needed where the simulation broke down
        let own = self.schedule(unknowns, schedule.frames).substeps;
        let moved = |k: usize| {
            let mut there = here.clone();
            there[k] += lengths[k];
            let there = unknowns.moved(&self.law, free, &there);
            let needed = self.schedule(&there, schedule.frames);
            let substeps = (needed.substeps * schedule.substeps).div_ceil(own);
            self.positions_at(&there, Schedule { substeps, ..needed })
        };
        // side by side: the threads of a single rollout wait for each other in every substep
        let (motion, motions) = rayon::join(
            || self.positions_at(unknowns, schedule),
            || (0..lengths.len()).into_par_iter().map(moved).collect::<Result<Vec<_>>>(),
        );
        let secants = motions?.into_iter().zip(lengths).map(|(motion, length)| Secant { motion, length });
        Ok(Moved { motion: motion?, along: Along::Secants(secants.collect()) })
    }

    /// The pixels of a frame of particles of this opacity and colour, `[rays, 4]`, and how they change along each unknown, `[rays, unknowns, 4]`.
    fn drawn(&self, moved: &Moved, [opacity, colour]: &[Tensor; 2], frame: usize) -> Result<(Tensor, Tensor)> {
        let (rays, settings) = (&self.observed.rays, Splat::of(self.particles, &self.surface));
        let draw = |motion: &Tensor, tangents: &[Tensor]| {
            let instants = match self.shutter.is_open() {
                true => {
                    let tangents: Vec<[Tensor; 3]> =
                        tangents.iter().map(|t| around(t, frame)).collect::<Result<_>>()?;
                    self.instants().jvp(&around(motion, frame)?, &tangents)?
                }
                false => vec![(row(motion, frame), tangents.iter().map(|tangent| row(tangent, frame)).collect())],
            };
            let draw = |(positions, directions): &(Tensor, Vec<Tensor>)| {
                render_jvp(positions, directions, opacity, colour, rays, &settings, &self.surface)
            };
            let drawn = instants.iter().map(draw).collect::<Result<Vec<_>>>()?;
            let (pixels, changes): (Vec<_>, Vec<_>) = drawn.into_iter().unzip();
            Ok::<_, gradreel::Error>((mean(&pixels)?, mean(&changes)?))
        };
        match &moved.along {
            Along::Tangents(tangents) => draw(&moved.motion, tangents),
            Along::Secants(secants) => {
                let (pixels, none) = draw(&moved.motion, &[])?;
                let tape = Tape::new();
                let here = tape.constant(pixels.clone());
                let changes = secants.iter().map(|Secant { motion, length }| {
                    let there = tape.constant(draw(motion, &[])?.0);
                    Ok(&(&there - &here) * (1.0 / length))
                });
                let changes: Vec<_> = changes.collect::<Result<_>>()?;
                let [first, others @ ..] = &changes[..] else { return Ok((pixels, none)) };
                let all = first.stack(&others.iter().collect::<Vec<_>>(), 1);
                Ok((pixels, all.value()?.clone()))
            }
        }
    }

    /// The same in free flight, where only velocity and spin tell: `c + R(t) (x₀ − c) + v t + g t²/2`.
    fn flight_tangents(&self, unknowns: &Unknowns, free: Free, schedule: Schedule) -> Result<(Tensor, Vec<Tensor>)> {
        let (frames, positions) = (schedule.frames, &self.particles.positions);
        let tensor = |values: Vec<f64>| Tensor::from_vec(values, [frames, positions.len(), 3]).cast(self.dtype);
        let turned =
            |spin| self.turned(spin, unknowns.depth, schedule).into_iter().flatten().flatten().collect::<Vec<f64>>();
        let times = || (0..frames).flat_map(|frame| vec![frame as f64 * schedule.frame_dt; 3 * positions.len()]);
        let (v, g) = (unknowns.velocity, self.world.gravity);
        let fallen = times().enumerate().map(|(i, t)| displacement(v, g, t)[i % 3]);
        let motion = tensor(turned(unknowns.spin).into_iter().zip(fallen).map(|(x, moved)| x + moved).collect())?;
        let tangent = |unknown| match unknown {
            Unknown::Velocity(along) => {
                let slope = unknowns.slope(&self.law, unknown);
                tensor(times().enumerate().map(|(i, t)| if i % 3 == along { slope * t } else { 0.0 }).collect())
            }
            Unknown::Spin(along) => {
                // a short way to both sides: what turns is smooth, and exact to a part in 10⁸
                let beside = |sign: f64| {
                    let mut spin = unknowns.spin;
                    spin[along] += sign * NEARBY;
                    turned(spin)
                };
                let share = unknowns.slope(&self.law, unknown) / (2.0 * NEARBY);
                tensor(beside(1.0).into_iter().zip(beside(-1.0)).map(|(high, low)| share * (high - low)).collect())
            }
            Unknown::Depth(axis) => tensor(self.depth_field(axis, unknowns.depth)?.to_vec()?.repeat(frames)),
            Unknown::Parameter(_) | Unknown::Contact | Unknown::Friction => {
                tensor(vec![0.0; 3 * frames * positions.len()])
            }
        };
        let tangents = free.list(&self.law).into_iter().map(tangent).collect::<Result<_>>()?;
        Ok((motion, tangents))
    }

    /// The particles at each frame as far as they are turned, not as they fall.
    pub(in crate::identify) fn turned(
        &self,
        spin: [f64; 3],
        depth: [f64; 4],
        schedule: Schedule,
    ) -> Vec<Vec<[f64; 3]>> {
        let body = self.sheared(depth);
        let (positions, frames) = (&body.positions, schedule.frames);
        if spin == [0.0; 3] {
            return vec![positions.clone(); frames];
        }
        let gyration = Gyration::of(&body);
        let turned = gyration.turned(spin, schedule.frame_dt, frames);
        turned.iter().map(|turned| positions.iter().map(|x| gyration.place(turned, *x)).collect()).collect()
    }

    /// The velocities of all particles for a spin of 1 rad/s about each axis, `[3, 3 particles]` \[m/s\].
    pub(in crate::identify) fn spin_field(&self, depth: [f64; 4]) -> Result<Tensor> {
        let body = self.sheared(depth);
        Gyration::of(&body).velocities(&body, self.world.dx, self.dtype)
    }

    /// How the particles move in the world for each unit of depth shear to the right (0) and upwards (1), of depth scale (2), or of the camera's
    /// pitch (3), `[particles, 3]` \[m\].
    fn depth_field(&self, axis: usize, depth: [f64; 4]) -> Result<Tensor> {
        let stands = self.observed.sight.map(|sight| (sight, sight.pitch(depth, self.ground)));
        let rate = |x: &[f64; 3]| match stands {
            None => [0.0; 3],
            Some((sight, pitch)) if axis == 3 => pitch.rate(sight.sheared_at(*x, depth)),
            Some((sight, pitch)) => pitch.along(sight.rates(*x)[axis]),
        };
        let values = self.particles.positions.iter().flat_map(rate).collect();
        Tensor::from_vec(values, [self.particles.len(), 3]).cast(self.dtype)
    }
}

/// How derivatives are taken along the free unknowns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::identify) enum Derivatives {
    /// In forward mode, of an infinitesimal step.
    Exact,
    /// As differences over a share of the longest step of a search, towards the middle of the prior.
    Ahead(f64),
}

impl Derivatives {
    /// Differences over a share of the longest step; exact ones for 0.
    pub fn reaching(share: f64) -> Self {
        if share > 0.0 { Self::Ahead(share) } else { Self::Exact }
    }
}

/// How far beside a spin its derivative is taken \[rad/s\].
const NEARBY: f64 = 1e-4;

/// A motion, and those beside it.
struct Moved {
    motion: Tensor,
    along: Along,
}

/// How a motion changes.
enum Along {
    /// With an infinitesimal step of each unknown.
    Tangents(Vec<Tensor>),
    /// With a finite one of each.
    Secants(Vec<Secant>),
}

/// The motion at another value of an unknown's coordinate, `length` away.
struct Secant {
    motion: Tensor,
    length: f64,
}

/// Positions with `height` added to every y.
fn raised(positions: Tensor, height: f64) -> Tensor {
    fn raise<T: gradreel::scalar::Real>(positions: &Tensor, height: f64) -> Tensor {
        let mut values = positions.slice::<T>().to_vec();
        values.chunks_exact_mut(3).for_each(|x| x[1] += T::from_f64(height));
        Tensor::from_vec(values, positions.shape())
    }
    match positions.dtype() {
        _ if height == 0.0 => positions,
        DType::F64 => raise::<f64>(&positions, height),
        _ => raise::<f32>(&positions, height),
    }
}

/// What is a frame before, at a frame of `[frames, particles, 3]`, and after it.
fn around(motion: &Tensor, frame: usize) -> Result<[Tensor; 3]> {
    let now = row(motion, frame);
    let [before, after] = beside(frame, motion.dims()[0]).map(|beside| match beside {
        Beside::At(frame) => Ok(row(motion, frame)),
        Beside::Beyond(frame) => {
            let (here, there) = (now.to_vec()?, row(motion, frame).to_vec()?);
            let beyond = here.iter().zip(there).map(|(here, there)| 2.0 * here - there).collect();
            Tensor::from_vec(beyond, now.dims()).cast(now.dtype())
        }
    });
    Ok([before?, now, after?])
}

/// One frame of `[frames, particles, 3]`.
pub(in crate::identify) fn row(motion: &Tensor, frame: usize) -> Tensor {
    let count = motion.dims()[1];
    match motion.dtype() {
        DType::F64 => Tensor::from_vec(motion.slice::<f64>()[3 * count * frame..][..3 * count].to_vec(), [count, 3]),
        _ => Tensor::from_vec(motion.slice::<f32>()[3 * count * frame..][..3 * count].to_vec(), [count, 3]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_counts_by_how_well_it_is_explained() {
        let frame = |loss: f64, slope: f64| Linearised {
            loss,
            gradient: vec![slope],
            curvature: vec![vec![2.0 * slope * slope]],
        };
        let frames = [frame(0.1, 1.0), frame(0.9, 1.0)];
        let found = Linearised::mean_log(&frames, 0.1);
        approx::assert_relative_eq!(found.loss, 0.5 * (0.2f64.ln() + 1f64.ln()), max_relative = 1e-12);
        approx::assert_relative_eq!(found.gradient[0], 0.5 * (1.0 / 0.2 + 1.0), max_relative = 1e-12);
        approx::assert_relative_eq!(found.curvature[0][0], 0.5 * (2.0 / 0.2 + 2.0), max_relative = 1e-12);
        // far above every loss the floor makes all frames alike
        let alike = Linearised::mean_log(&frames, 1e6);
        approx::assert_relative_eq!(alike.gradient[0], 1e-6, max_relative = 1e-5);
    }
}
