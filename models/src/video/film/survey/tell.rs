//! What is told of a survey.

use super::chain::Link;
use super::flight::LEAST_SCATTER;
use super::search::Scene;
use super::{Size, Survey, brief};
use crate::video::FreeFlight;
use crate::video::parabola::GRAVITY;
use crate::video::story::{Curve, Sight, Story, WITHIN};

/// Relative error of a speed at a hit for an error of one interval in its time is bounded by this share of it.
const SPEED: f64 = 0.03;

impl Survey {
    /// Adds phases, track and curves to a story whose positions are in pixels of `scale` to one of the survey.
    pub fn told_in(&self, story: &mut Story, scale: f64) {
        let scene = Scene { pieces: &self.pieces, times: &self.times };
        let within = WITHIN * scene.interval();
        story.contact = brief::longest(&brief::around(&scene, &self.track), scene.interval());
        story.phases.clone_from(&self.phases);
        for (k, spot) in self.track.spots.iter().enumerate() {
            let Some(piece) = spot.map(|j| &self.pieces[k][j]) else { continue };
            let across = scale * piece.across();
            story.track.push(Sight {
                number: self.numbers[k],
                seconds: self.times[k],
                middle: piece.middle.map(|x| x * scale),
                across,
            });
        }
        for (link, hit) in self.track.chain.links.iter().zip(&self.track.hits) {
            let flight = &link.flight;
            let end = hit.map_or(self.times[flight.last()] + within, |hit| hit.time);
            story.curves.push(Curve::of(&flight.path, [self.times[flight.first()], end], scale));
            let sight = |&(k, j): &(usize, usize)| {
                let piece = &self.pieces[k][j];
                let across = scale * piece.across_direction(flight.path.velocity_at(self.times[k]));
                let middle = piece.middle.map(|x| x * scale);
                Sight { number: self.numbers[k], seconds: self.times[k], middle, across }
            };
            story.flights.push(FreeFlight {
                sights: flight.members.iter().filter(|(k, j)| !self.pieces[*k][*j].cut).map(sight).collect(),
                scatter: scale * flight.path.scatter.max(LEAST_SCATTER),
                bounces: hit.is_some_and(|hit| hit.after.is_some()),
            });
        }
    }

    /// Speed after the chosen contact as a share of that before, and its standard deviation.
    fn restitution(&self) -> Option<[f64; 2]> {
        let run = self.run?;
        let after = run.hit.after?;
        let value = -after[1] / run.hit.before[1];
        let links = &self.track.chain.links;
        let error = |link: &Link| {
            let time = self.times[link.flight.last()] - self.times[link.flight.first()];
            let slope = link.flight.path.scatter.max(LEAST_SCATTER) / time.max(1e-9) * 2.0;
            slope / run.hit.before[1]
        };
        let fits = error(&links[run.flight]).hypot(error(links.get(run.flight + 1)?));
        (0.0..=1.1).contains(&value).then_some([value, fits.hypot(SPEED * value)])
    }

    /// The chosen part in words, for a film of `count` pictures.
    pub fn said(&self, count: usize) -> Vec<String> {
        let mut said = Vec::new();
        if let Some(run) = &self.run {
            let link = &self.track.chain.links[run.flight].flight;
            let begins = match run.flight {
                0 => "free from",
                _ => "free again from",
            };
            let mut again: Vec<String> =
                self.track.hits[run.flight + 1..].iter().flatten().map(|hit| format!("{:.2} s", hit.time)).collect();
            if again.len() > 4 {
                again.truncate(4);
                again.push("…".to_owned());
            }
            let again = if again.is_empty() { String::new() } else { format!(", again at {}", again.join(", ")) };
            said.push(format!(
                "frames {}–{} of {count}: {begins} {:.2} s, hits at {:.2} s{again}",
                self.numbers[run.first],
                self.numbers[run.last],
                self.times[run.first.max(link.first())],
                run.hit.time
            ));
        }
        let [low, high] = self.diameter.interval_90().map(|x| 100.0 * x);
        said.push(format!(
            "flights: {} free flights of one acceleration make it {:.2} cm across ({low:.2} to {high:.2} cm with 90 %)",
            self.track.chain.links.len(),
            100.0 * self.diameter.metres
        ));
        if let [used, others @ ..] = &self.objects[..]
            && !others.is_empty()
        {
            let cm = |size: &Size| format!("{:.1} cm", 100.0 * size.metres);
            let others: Vec<String> = others
                .iter()
                .enumerate()
                .map(|(k, size)| format!("--object {} is {} across", k + 2, cm(size)))
                .collect();
            said.push(format!(
                "objects: several fall together; the first is {} across, {}",
                cm(used),
                others.join(", ")
            ));
        }
        if let Some([value, deviation]) = self.restitution() {
            said.push(format!("bounce: it leaves with {value:.2} ± {deviation:.2} of the speed with which it hits"));
        }
        said
    }

    /// Metres in a pixel of the survey by the longest flight, and the speed at its end \[m/s\].
    pub fn speed(&self) -> f64 {
        let link = self.track.chain.links.iter().max_by_key(|link| link.flight.members.len()).expect("a flight");
        let velocity = link.flight.path.velocity_at(self.times[link.flight.last()]);
        GRAVITY / link.acceleration * velocity[0].hypot(velocity[1])
    }
}
