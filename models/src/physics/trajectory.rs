//! Many substeps: frames forward, and the cotangents of all frames back to the start.

use gradreel::Result;

use super::forward::Tangent;
use super::remat::Remat;
use super::row::Number;
use super::state::State;
use super::substep::Simulation;
use super::timestep::Schedule;

/// The states kept by a rollout for its backward pass.
#[derive(Debug)]
pub(crate) struct Trajectory<T> {
    schedule: Schedule,
    segment: usize,
    snapshots: Vec<State<T>>,
}

impl<T: Number> Trajectory<T> {
    /// Simulates from `start`, calling `frame(index, state)` at each frame. Without `remat` no states are kept.
    pub fn forward(
        simulation: &mut Simulation<'_, T>,
        start: State<T>,
        schedule: Schedule,
        remat: Option<Remat>,
        mut frame: impl FnMut(usize, &State<T>),
    ) -> Result<Self> {
        let steps = schedule.steps();
        let segment = remat.map_or(steps, |remat| remat.segment(steps, start.bytes())).max(1);
        let mut snapshots = Vec::new();
        frame(0, &start);
        let mut now = start;
        let mut next = now.zeros_like();
        simulation.substep = 0;
        for step in 0..steps {
            simulation.substep(&now, &mut next)?;
            if remat.is_some() && step % segment == 0 {
                snapshots.push(std::mem::replace(&mut now, next.zeros_like()));
            }
            std::mem::swap(&mut now, &mut next);
            if (step + 1) % schedule.substeps == 0 {
                frame((step + 1) / schedule.substeps, &now);
            }
        }
        Ok(Self { schedule, segment, snapshots })
    }

    /// Simulates from `start` together with tangents, calling `frame(index, state, tangents)` at each frame.
    pub fn forward_jvp(
        simulation: &mut Simulation<'_, T>,
        start: State<T>,
        mut tangents: Vec<Tangent<T>>,
        schedule: Schedule,
        mut frame: impl FnMut(usize, &State<T>, &[Tangent<T>]),
    ) -> Result<()> {
        frame(0, &start, &tangents);
        let mut now = start;
        let mut next = now.zeros_like();
        simulation.substep = 0;
        for step in 1..=schedule.steps() {
            simulation.substep_jvp(&now, &mut next, &mut tangents)?;
            std::mem::swap(&mut now, &mut next);
            if step % schedule.substeps == 0 {
                frame(step / schedule.substeps, &now, &tangents);
            }
        }
        Ok(())
    }

    /// Propagates the cotangents of all frames back to the start: `add(index, cotangent)` adds that of a frame. Returns
    /// the cotangent of the start; those of density and parameters are in the simulation.
    pub fn backward(
        &self,
        simulation: &mut Simulation<'_, T>,
        particles: usize,
        add: impl Fn(usize, &mut State<T>),
    ) -> Result<State<T>> {
        let mut cotangent = self.snapshots.first().map_or_else(|| State::zeros(particles), State::zeros_like);
        let mut scratch = cotangent.clone();
        let mut again = vec![cotangent.clone(); self.segment.min(self.schedule.steps()).saturating_sub(1)];
        for (index, snapshot) in self.snapshots.iter().enumerate().rev() {
            let first = index * self.segment;
            let last = (first + self.segment).min(self.schedule.steps());
            simulation.substep = first;
            for at in 0..last - first - 1 {
                let (before, rest) = again.split_at_mut(at);
                simulation.substep(before.last().unwrap_or(snapshot), &mut rest[0])?;
            }
            for step in (first..last).rev() {
                if (step + 1) % self.schedule.substeps == 0 {
                    add((step + 1) / self.schedule.substeps, &mut cotangent);
                }
                let now = if step == first { snapshot } else { &again[step - first - 1] };
                simulation.substep = step;
                simulation.substep_vjp(now, &mut scratch, &mut cotangent)?;
            }
        }
        add(0, &mut cotangent);
        Ok(cotangent)
    }
}
