//! The empty scene behind what moves, from a few pictures spread over the action.

use rayon::prelude::*;

use super::sequence::{Rgb, Sequence};
use crate::video::film::backdrop;
use crate::video::film::median::median;
use crate::video::image::Image;

/// Number of pictures that are compared.
const PICTURES: usize = 31;

/// Share of the pictures that are spread evenly over time; the others are spread evenly over the change, so that a
/// long wait does not outweigh the action.
const BY_TIME: f64 = 0.4;

/// Least standard deviation of a pixel \[levels\]: rounding and compression.
const LEAST_NOISE: f32 = 1.2;

/// A background with the noise of its pixels.
pub(in crate::video::film) struct Background {
    pub colour: Vec<Rgb>,
    /// Standard deviation from one picture to the next \[levels\].
    pub noise: Vec<f32>,
}

impl Background {
    /// The background of a sequence.
    pub fn of(sequence: &Sequence) -> Self {
        let numbers = spread(sequence);
        let chosen: Vec<&[Rgb]> = numbers.iter().map(|k| &sequence.pictures[*k][..]).collect();
        let next = |k: &usize| if k + 1 < sequence.pictures.len() { k + 1 } else { k - 1 };
        let pairs: Vec<(&[Rgb], &[Rgb])> = match sequence.pictures.len() {
            0 | 1 => vec![],
            _ => numbers.iter().map(|k| (&sequence.pictures[*k][..], &sequence.pictures[next(k)][..])).collect(),
        };
        let images: Vec<Image> = chosen.iter().map(|pixels| sequence.image(pixels)).collect();
        let empty = backdrop::of(&images);
        let noise = |i: usize| {
            // mean over the channels, for a scale finer than a level
            let steps = |(a, b): &(&[Rgb], &[Rgb])| (0..3).map(|c| u16::from(a[i][c].abs_diff(b[i][c]))).sum::<u16>();
            let mut steps: Vec<u16> = pairs.iter().map(steps).collect();
            // a difference of two normal variables is within 0.954 of their deviations half of the time
            let step = if steps.is_empty() { 0.0 } else { f32::from(median(&mut steps)) / 3.0 / 0.954 };
            step.max(LEAST_NOISE)
        };
        let colour = empty.pixels.iter().map(|p| [p[0], p[1], p[2]]).collect();
        Self { colour, noise: (0..images[0].pixels.len()).into_par_iter().map(noise).collect() }
    }
}

/// Indices of pictures spread over time and over change.
pub(super) fn spread(sequence: &Sequence) -> Vec<usize> {
    let count = sequence.pictures.len();
    if count <= PICTURES {
        return (0..count).collect();
    }
    let step = (sequence.pictures[0].len() / 4096).max(1);
    let change = |pair: &[Vec<Rgb>]| -> f64 {
        let pixels = pair[0].iter().zip(&pair[1]).step_by(step);
        pixels.map(|(a, b)| (0..3).map(|c| f64::from(a[c].abs_diff(b[c])).max(4.0) - 4.0).sum::<f64>()).sum()
    };
    let changes: Vec<f64> = sequence.pictures.windows(2).map(change).collect();
    let total: f64 = changes.iter().sum::<f64>().max(f64::MIN_POSITIVE);
    // progress from 0 to 1, partly of time and partly of change
    let even = BY_TIME / (count - 1) as f64;
    let mut progress = vec![0.0; count];
    for k in 1..count {
        progress[k] = progress[k - 1] + even + (1.0 - BY_TIME) * changes[k - 1] / total;
    }
    let last = progress[count - 1];
    let mut chosen: Vec<usize> = (0..PICTURES)
        .map(|n| {
            let wanted = last * n as f64 / (PICTURES - 1) as f64;
            progress.partition_point(|p| *p < wanted).min(count - 1)
        })
        .collect();
    chosen.dedup();
    chosen
}
