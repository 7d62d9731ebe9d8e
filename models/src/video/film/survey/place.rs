//! Where the object and other moving things are at a time, in pictures of any size.

use super::Survey;
use super::components::Component;
use super::register::Homography;

/// Margin around the object, in its widths and in pixels of the survey.
const MARGIN: (f64, f64) = (0.5, 3.0);

/// Distance from the object's edge within which a component is a fragment of it \[pixels of the survey\], and least area
/// of another thing as a share of the object's.
const REACH: f64 = 4.0;
const LEAST_OTHER: f64 = 0.3;

/// A rectangle: left, top, right and bottom \[pixels\].
pub(in crate::video::film) type Rect = [f64; 4];

impl Survey {
    /// Index of the surveyed picture nearest to a picture of the film.
    fn index(&self, number: usize) -> usize {
        let after = self.numbers.partition_point(|n| *n < number).min(self.numbers.len() - 1);
        match after.checked_sub(1) {
            Some(before) if number.abs_diff(self.numbers[before]) < self.numbers[after].abs_diff(number) => before,
            _ => after,
        }
    }

    /// Where a picture of the film shows the places of the camera at rest; `None` if the camera is at rest.
    pub fn map(&self, number: usize) -> Option<Homography> {
        let maps = &self.motion.as_ref()?.maps;
        let after = self.numbers.partition_point(|n| *n < number).min(maps.len() - 1);
        let before = after.saturating_sub(usize::from(self.numbers[after] > number));
        let gap = (self.numbers[after] - self.numbers[before]) as f64;
        let share =
            if gap > 0.0 { (number.max(self.numbers[before]) - self.numbers[before]) as f64 / gap } else { 0.0 };
        Some(std::array::from_fn(|i| (1.0 - share) * maps[before][i] + share * maps[after][i]))
    }

    /// The object's component in a surveyed picture.
    pub fn component(&self, number: usize) -> Option<&Component> {
        let k = self.index(number);
        (self.numbers[k] == number).then_some(())?;
        self.track.spots[k].map(|j| &self.pieces[k][j])
    }

    /// The components of a surveyed picture that are not the object.
    pub fn others(&self, number: usize) -> Vec<&Component> {
        let k = self.index(number);
        if self.numbers[k] != number {
            return vec![];
        }
        let Some(own) = self.component(number) else { return vec![] };
        // fragments of the object itself are near it
        let reach = 0.5 * (own.across().max(self.width()) + REACH);
        let apart = |piece: &&Component| {
            let off = (piece.middle[0] - own.middle[0]).hypot(piece.middle[1] - own.middle[1]);
            !piece.covers(own.middle) && off > reach && piece.area > LEAST_OTHER * own.area
        };
        self.pieces[k].iter().filter(apart).collect()
    }

    /// Centre of the object at a time between its flights' positions, on the flight before or after the hit.
    fn predicted(&self, time: f64) -> Option<[f64; 2]> {
        let links = &self.track.chain.links;
        let begins = |k: usize| self.times[links[k].flight.first()];
        let k = (0..links.len()).rfind(|k| begins(*k) <= time)?;
        let path = |k: usize| links[k].flight.path.at(time);
        match self.track.hits[k] {
            Some(hit) if time < hit.time => Some(path(k)),
            Some(hit) if hit.after.is_some() && k + 1 < links.len() => Some(path(k + 1)),
            None if time <= self.times[links[k].flight.last()] => Some(path(k)),
            _ => None,
        }
    }

    /// Time of a picture of the film.
    fn time(&self, number: usize) -> f64 {
        let after = self.numbers.partition_point(|n| *n < number).min(self.numbers.len() - 1);
        let before = after.saturating_sub(usize::from(self.numbers[after] > number));
        let gap = (self.numbers[after] - self.numbers[before]).max(1) as f64;
        let share = (number.max(self.numbers[before]) - self.numbers[before]) as f64 / gap;
        self.times[before] + share * (self.times[after] - self.times[before])
    }

    /// Where the object is in a picture of the film, with a margin; between pictures in which it is known, where it
    /// can be; `None` beyond them.
    pub fn window(&self, number: usize) -> Option<Rect> {
        let k = self.index(number);
        let known = |k: &usize| self.track.spots[*k].is_some();
        let before = (0..=k).rev().find(known);
        let after = (k..self.numbers.len()).find(known);
        let exact = self.numbers[k] == number && self.track.spots[k].is_some();
        let around: Vec<usize> = if exact { vec![k] } else { vec![before?, after?] };
        let width = self.width();
        let margin = MARGIN.0 * width + MARGIN.1;
        if let Some([x, y]) = self.predicted(self.time(number)).filter(|_| !exact) {
            let reach = width + margin;
            return Some([x - reach, y - reach, x + reach, y + reach]);
        }
        let rects = around.iter().map(|k| {
            let piece = &self.pieces[*k][self.track.spots[*k].expect("known")];
            let [left, top, right, bottom] = piece.rect.map(|v| v as f64);
            // bright cores of blurred objects are smaller than the object
            let [x, y] = piece.middle;
            let half = 0.5 * width;
            [left.min(x - half), top.min(y - half), right.max(x + half), bottom.max(y + half)]
        });
        let whole = rects.reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])])?;
        Some([whole[0] - margin, whole[1] - margin, whole[2] + margin, whole[3] + margin])
    }

    /// Usual width of the object \[pixels of the survey\].
    pub fn width(&self) -> f64 {
        super::flight::middle(self.track.chain.links.iter().map(|link| link.flight.across).collect())
    }
}
