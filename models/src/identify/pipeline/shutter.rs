//! The shutter of a film, from the free flight: there nothing but the shutter changes the shape of a silhouette.

use std::time::Instant;

use gradreel::Result;

use crate::identify::pipeline::context::{Context, LEAST};
use crate::identify::pipeline::reconstruct::DTYPE;
use crate::identify::run::Run;
use crate::identify::solve::{GaussNewton, Setting};
use crate::identify::uncertainty::prior::Prior;
use crate::identify::{Free, Problem, Stage, Unknowns};
use crate::video::Shutter;

/// Exposures that are tried, in intervals between frames.
const EXPOSURES: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// Times in which all rows are read that are tried, in intervals between frames.
const READOUTS: [f64; 5] = [-1.0, -0.5, 0.0, 0.5, 1.0];

/// A shutter that is not closed at once must be more probable than one that is by so much \[nat\].
const WORTH: f64 = 3.0;

/// Least number of frames of free flight that show a shutter.
const FRAMES: usize = 4;

impl Context<'_> {
    /// Finds exposure and row time where a film leaves them open; neither where it makes no difference.
    ///
    /// # Errors
    /// What the searches and writing return.
    pub fn shutter(&self, run: &mut Run, flight: usize, start: &Unknowns) -> Result<()> {
        let shown = self.is_film() && flight >= FRAMES;
        let dt = self.observed.frame_dt;
        if shown && run.config.clip.film.exposure.is_none() {
            let found = self.tried(run, Stage::Exposure, flight, start, &EXPOSURES, &|shutter, share| Shutter {
                exposure: share * dt,
                ..shutter
            })?;
            run.config.clip.film.exposure = Some(found * dt);
            if found > 0.0 {
                run.note(format!(
                    "the pictures are blurred by their exposure, taken to be {:.2} ms (--exposure gives another)",
                    1e3 * found * dt
                ));
            }
            run.save_config()?;
            run.save()?;
        }
        let count = self.observed.rows.as_ref().map_or(1.0, |rows| rows.count());
        if shown && run.config.clip.film.row_time.is_none() {
            let row = dt / count;
            let found = self.tried(run, Stage::RowTime, flight, start, &READOUTS, &|shutter, share| Shutter {
                row_time: share * row,
                ..shutter
            })?;
            run.config.clip.film.row_time = Some(found * row);
            if found != 0.0 {
                run.note(format!(
                    "the rows of the pictures are read one after the other, taken to be {:.2} µs apart (--row-time gives another)",
                    1e6 * found * row
                ));
            }
            run.save_config()?;
            run.save()?;
        }
        Ok(())
    }

    /// The share that explains the flight best: each is tried with the velocity that is most probable then.
    fn tried(
        &self,
        run: &mut Run,
        stage: Stage,
        flight: usize,
        start: &Unknowns,
        shares: &[f64],
        shutter: &dyn Fn(Shutter, f64) -> Shutter,
    ) -> Result<f64> {
        let since = Instant::now();
        let fallen = self.fall(run)?;
        let free = self.freedom_of_fall(run);
        let particles = self.particles(run)?;
        let known = run.config.clip.film.shutter();
        let problem = Problem::new(&particles, self.observed, self.law.clone(), &run.config, DTYPE).flying();
        let setting = |share: &f64| {
            let problem = Problem { shutter: shutter(known, *share), ..problem.clone() };
            Setting { problem, free, frames: 0..flight, floor: LEAST }
        };
        let settings: Vec<Setting<'_>> = shares.iter().map(setting).collect();
        let pictures = (flight * self.observed.views.len()) as f64;
        let search = |k: usize| {
            let prior = Prior::of(self.law, free, start, fallen.as_ref());
            GaussNewton::new(prior, k, pictures, 1, start)
        };
        let mut searches: Vec<GaussNewton<'_>> = (0..shares.len()).map(search).collect();
        self.searched(run, stage, 1, &settings, &mut searches)?;
        let costs: Vec<f64> = searches.iter().map(|search| search.best().cost).collect();
        if !run.has_finished(stage) {
            run.finish(stage, since)?;
        }
        Ok(chosen(shares, &costs))
    }

    /// The velocity, and the pitch where only the fall says it.
    fn freedom_of_fall(&self, run: &Run) -> Free {
        let free = Free::Velocity;
        if self.pitch_is_open(run) { free.with_pitch(self.law) } else { free }
    }
}

/// The most probable of evenly spaced shares, between them by the parabola through its neighbours; 0 unless another is worth it.
fn chosen(shares: &[f64], costs: &[f64]) -> f64 {
    let none = shares.iter().zip(costs).find(|(share, _)| **share == 0.0).map_or(f64::INFINITY, |(_, cost)| *cost);
    let best = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).expect("there are shares");
    if costs[best] + WORTH >= none {
        return 0.0;
    }
    let beside = best.checked_sub(1).zip(Some(best + 1).filter(|after| *after < costs.len()));
    let Some((before, after)) = beside.filter(|(a, b)| costs[*a].is_finite() && costs[*b].is_finite()) else {
        return shares[best];
    };
    let (falls, rises) = (costs[before] - costs[best], costs[after] - costs[best]);
    let bend = falls + rises;
    let off = if bend > 0.0 { 0.5 * (falls - rises) / bend } else { 0.0 };
    shares[best] + off * (shares[after] - shares[best])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_most_probable_share_is_chosen_between_those_tried() {
        let parabola = |at: f64| EXPOSURES.map(|share| 100.0 * (share - at).powi(2) - 40.0);
        for at in [0.3, 0.5, 0.66] {
            assert!((chosen(&EXPOSURES, &parabola(at)) - at).abs() < 1e-12);
        }
        assert_eq!(chosen(&EXPOSURES, &parabola(1.4)), 1.0, "the longest that is tried");
        assert!((chosen(&READOUTS, &READOUTS.map(|share| 30.0 * (share + 0.45_f64).powi(2))) + 0.45).abs() < 1e-12);
    }

    #[test]
    fn a_shutter_that_makes_no_difference_is_left_out() {
        assert_eq!(chosen(&EXPOSURES, &[-10.0, -10.5, -12.9, -11.0, -9.0]), 0.0);
        assert!(chosen(&EXPOSURES, &[-10.0, -10.5, -13.1, -11.0, -9.0]) > 0.4);
        assert_eq!(chosen(&EXPOSURES, &[-10.0, f64::INFINITY, f64::INFINITY, f64::INFINITY, f64::INFINITY]), 0.0);
        assert_eq!(chosen(&EXPOSURES, &[f64::INFINITY, f64::INFINITY, -20.0, f64::INFINITY, 0.0]), 0.5);
    }
}
