//! The network's bodies beside simpler ones, on the pictures of a set.

use gradreel::Result;
use serde::Serialize;

use super::DepthNetwork;
use super::agreement::{View, wrong_sign};
use super::features::MASK;
use super::measure::{Layered, Seen, TILTED_DEG, mean, rms_error, spearman};
use super::picture::PIXELS;
use super::pose::Pose;
use super::sample::Sample;

/// Factors of the thickness of "as deep as wide" that are tried.
const FACTORS: std::ops::Range<usize> = 5..21;

fn factor(step: usize) -> f64 {
    0.1 * step as f64
}

/// Factors of the network's middle surface and of its thickness that are tried, as pairs.
const SCALES: [f64; 5] = [0.8, 0.9, 1.0, 1.1, 1.2];

fn pair_of(pair: usize) -> [f64; 2] {
    [SCALES[pair / SCALES.len()], SCALES[pair % SCALES.len()]]
}

/// What is measured on one picture.
struct Row {
    solid: usize,
    /// IoU of "as deep as wide" with each factor: in a plane across the view, and in the true middle plane.
    flat: Vec<f64>,
    tilted: Vec<f64>,
    /// IoU of the network's body with its middle surface and its thickness scaled by pairs of factors.
    scaled: Vec<f64>,
    /// IoU of the network's body, of its mirror image in depth, and of the body from the silhouette alone.
    network: f64,
    turned: f64,
    bare: f64,
    /// Errors of front and back, and the deviation of the true ones.
    errors: [f64; 2],
    spreads: [f64; 2],
    /// True and said tilt \[°\], the angle between the normals, and whether a true tilt above 20° is said to the wrong side.
    tilts: [f64; 2],
    normal: f64,
    wrong: Option<f64>,
    /// Mean expected error of the front \[D\], and shares of the front's errors below the medians and the 90 % quantiles.
    expected: f64,
    within: [f64; 2],
}

/// The pictures of a set.
pub(crate) struct Comparison {
    rows: Vec<Row>,
}

/// What a set chooses for others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Choice {
    /// Factor of "as deep as wide".
    factor: usize,
    /// Pair of factors of the network's body.
    scales: usize,
}

/// A mean with its standard error over solids.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Estimate {
    pub mean: f64,
    pub error: f64,
}

/// The figures of a set. Shares are 0 to 1, depths in diameters.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Figures {
    pub pictures: usize,
    pub solids: usize,
    /// Factor of "as deep as wide" that was best on the validation split.
    pub factor: f64,
    pub as_deep_as_wide: Estimate,
    pub best_tilt: Estimate,
    pub network: Estimate,
    /// The same with the factors of middle surface and thickness that were best on the validation split.
    pub scales: [f64; 2],
    pub scaled: Estimate,
    pub silhouette_alone: Estimate,
    pub mirrored_in_depth: Estimate,
    pub gain: Estimate,
    pub front_rms: Estimate,
    pub front_rms_flat: Estimate,
    pub back_rms: Estimate,
    pub back_rms_flat: Estimate,
    /// Pictures whose true middle plane tilts by more than 20°, how many of them tilt to the right side, and the median error of the
    /// normal beside that of no tilt \[°\].
    pub tilted: usize,
    pub right_sign: Estimate,
    pub normal_error_deg: f64,
    pub tilt_deg: f64,
    /// Of the tilted pictures that are said to tilt by more than 20°: how many, and the share of right signs.
    pub said_tilted: usize,
    pub right_sign_where_said: f64,
    /// Rank correlation of the expected error with the front's error and with the IoU.
    pub ranks_error: f64,
    pub ranks_overlap: f64,
    /// Shares of the front's errors within the expected medians and 90 % quantiles.
    pub within_50: f64,
    pub within_90: f64,
    /// IoU of the surer half of the pictures and of the others, and of "as deep as wide" on both.
    pub surer_half: [f64; 2],
    pub other_half: [f64; 2],
}

impl Comparison {
    /// Compares on some pictures.
    ///
    /// # Errors
    /// If the network cannot be evaluated.
    pub fn of(network: &DepthNetwork, views: &[View]) -> Result<Self> {
        let features: Vec<&[f32]> = views.iter().map(|view| &*view.sample.features).collect();
        let said = network.layers(&features, &Pose::ALL)?;
        let bare: Vec<Vec<f32>> =
            features.iter().map(|planes| [&[0.0; MASK * PIXELS][..], &planes[MASK * PIXELS..]].concat()).collect();
        let bare = network.layers(&bare.iter().map(|planes| &**planes).collect::<Vec<_>>(), &Pose::ALL)?;
        let rows = views.iter().zip(said.iter().zip(&bare));
        Ok(Self { rows: rows.map(|(view, (said, bare))| Row::of(view.solid, &view.sample, said, bare)).collect() })
    }

    /// The factors that are best here.
    pub fn choice(&self) -> Choice {
        let best = |count: usize, value: &dyn Fn(&Row, usize) -> f64| {
            let mean_of = |k: usize| mean(self.rows.iter().map(|row| value(row, k)));
            (0..count).max_by(|a, b| mean_of(*a).total_cmp(&mean_of(*b))).expect("there are factors")
        };
        Choice {
            factor: best(FACTORS.len(), &|row, k| row.flat[k]),
            scales: best(SCALES.len() * SCALES.len(), &|row, k| row.scaled[k]),
        }
    }

    /// The figures, with factors chosen elsewhere.
    pub fn figures(&self, chosen: Choice) -> Figures {
        let at = chosen.factor;
        let all = |value: &dyn Fn(&Row) -> f64| estimate(self.rows.iter().map(|row| (row.solid, value(row))));
        let tilted: Vec<&Row> = self.rows.iter().filter(|row| row.wrong.is_some()).collect();
        let right = |row: &Row| 1.0 - row.wrong.unwrap_or(0.0);
        let said: Vec<&&Row> = tilted.iter().filter(|row| row.tilts[1] > TILTED_DEG).collect();
        let list = |value: &dyn Fn(&Row) -> f64| self.rows.iter().map(value).collect::<Vec<f64>>();
        let expected = list(&|row| row.expected);
        let middle = median(&expected);
        let half = |sure: bool| {
            let rows = || self.rows.iter().filter(move |row| (row.expected < middle) == sure);
            [mean(rows().map(|row| row.network)), mean(rows().map(|row| row.flat[at]))]
        };
        let mut solids: Vec<usize> = self.rows.iter().map(|row| row.solid).collect();
        solids.dedup();
        Figures {
            pictures: self.rows.len(),
            solids: solids.len(),
            factor: factor(FACTORS.start + at),
            as_deep_as_wide: all(&|row| row.flat[at]),
            best_tilt: all(&|row| row.tilted[at]),
            network: all(&|row| row.network),
            scales: pair_of(chosen.scales),
            scaled: all(&|row| row.scaled[chosen.scales]),
            silhouette_alone: all(&|row| row.bare),
            mirrored_in_depth: all(&|row| row.turned),
            gain: all(&|row| row.network - row.flat[at]),
            front_rms: all(&|row| row.errors[0]),
            front_rms_flat: all(&|row| row.spreads[0]),
            back_rms: all(&|row| row.errors[1]),
            back_rms_flat: all(&|row| row.spreads[1]),
            tilted: tilted.len(),
            right_sign: estimate(tilted.iter().map(|row| (row.solid, right(row)))),
            normal_error_deg: median(&tilted.iter().map(|row| row.normal).collect::<Vec<_>>()),
            tilt_deg: median(&tilted.iter().map(|row| row.tilts[0]).collect::<Vec<_>>()),
            said_tilted: said.len(),
            right_sign_where_said: mean(said.iter().map(|row| right(row))),
            ranks_error: spearman(&expected, &list(&|row| row.errors[0])),
            ranks_overlap: spearman(&expected, &list(&|row| row.network)),
            within_50: mean(self.rows.iter().map(|row| row.within[0])),
            within_90: mean(self.rows.iter().map(|row| row.within[1])),
            surer_half: half(true),
            other_half: half(false),
        }
    }
}

impl Row {
    fn of(solid: usize, sample: &Sample, said: &[Vec<f32>; 4], bare: &[Vec<f32>; 4]) -> Self {
        let seen = Seen::of(sample);
        let body = |layers: &[Vec<f32>; 4]| Layered { front: seen.picked(&layers[0]), back: seen.picked(&layers[1]) };
        let found = body(said);
        let opposite = |values: &[f64]| values.iter().map(|x| -x).collect();
        let turned = Layered { front: opposite(&found.back), back: opposite(&found.front) };
        let (truth, planes) = (&seen.truth, [&seen.truth, &found].map(|body| seen.plane(body)));
        let zero = vec![0.0; truth.front.len()];
        let scales: Vec<f64> = seen.picked(&said[2]).into_iter().map(f64::exp).collect();
        let errors: Vec<f64> = found.front.iter().zip(&truth.front).map(|(a, b)| (a - b).abs()).collect();
        // quantiles of a Laplace distribution with the mean error b: −b ln(1 − p)
        let within = |share: f64| {
            let below = |(error, scale): (&f64, &f64)| f64::from(u8::from(*error <= -scale * (1.0 - share).ln()));
            mean(errors.iter().zip(&scales).map(below))
        };
        let scaled = |pair: usize| {
            let [middle, thick] = pair_of(pair);
            let layer = |sign: f64| {
                let both = found.front.iter().zip(&found.back);
                both.map(|(f, b)| 0.5 * (middle * (f + b) + sign * thick * (b - f))).collect()
            };
            seen.overlap(&Layered { front: layer(-1.0), back: layer(1.0) })
        };
        let wide = |plane| FACTORS.map(|step| seen.overlap(&seen.as_deep_as_wide(factor(step), plane))).collect();
        Self {
            solid,
            flat: wide(None),
            tilted: wide(Some(&planes[0])),
            scaled: (0..SCALES.len() * SCALES.len()).map(scaled).collect(),
            network: seen.overlap(&found),
            turned: seen.overlap(&turned),
            bare: seen.overlap(&body(bare)),
            errors: [rms_error(&found.front, &truth.front), rms_error(&found.back, &truth.back)],
            spreads: [rms_error(&zero, &truth.front), rms_error(&zero, &truth.back)],
            tilts: planes.map(|plane| plane.tilt_deg()),
            normal: planes[1].angle_deg(&planes[0]),
            wrong: wrong_sign(&planes[0], &planes[1]),
            expected: mean(scales.iter().copied()),
            within: [within(0.5), within(0.9)],
        }
    }
}

/// Mean of values, and its standard error from the means of their groups.
fn estimate(values: impl Iterator<Item = (usize, f64)>) -> Estimate {
    let mut groups = std::collections::BTreeMap::<usize, (f64, f64)>::new();
    let (mut sum, mut count) = (0.0, 0.0);
    for (group, value) in values {
        let entry = groups.entry(group).or_default();
        *entry = (entry.0 + value, entry.1 + 1.0);
        (sum, count) = (sum + value, count + 1.0);
    }
    let means: Vec<f64> = groups.values().map(|(sum, count)| sum / count).collect();
    let middle = mean(means.iter().copied());
    let variance = means.iter().map(|x| (x - middle).powi(2)).sum::<f64>() / (means.len() as f64 - 1.0).max(1.0);
    Estimate {
        mean: if count > 0.0 { sum / count } else { 0.0 },
        error: (variance / (means.len() as f64).max(1.0)).sqrt(),
    }
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use gradreel::{DType, Key};

    use super::*;
    use crate::depth::agreement::two_views;
    use crate::depth::network::{DepthNet, DepthSizes};
    use crate::depth::testing::{ball, boxed};
    use crate::layers::initialise;

    /// A fresh network says "as deep as wide": all bodies agree, and mirroring in depth changes nothing.
    #[test]
    fn a_fresh_network_is_as_deep_as_wide() {
        let sizes = DepthSizes { channels: [8, 8, 16, 16], blocks: [1; 4] };
        let params = initialise(Key::new(1), DType::F32, |scope| DepthNet::new(scope, &sizes)).unwrap();
        let network = DepthNetwork::new(sizes, params);
        let solids = [boxed([0.5, 0.1, 0.3]), ball(0.5, 24), boxed([0.2, 0.5, 0.2])].map(Arc::new);
        let views = two_views(&solids, Key::new(3), 6);
        assert_eq!(views.iter().map(|view| view.solid).collect::<Vec<_>>(), [0, 0, 1, 1, 2, 2]);
        let comparison = Comparison::of(&network, &views).unwrap();
        let plain = Choice { factor: 10 - FACTORS.start, scales: 12 };
        let figures = comparison.figures(plain);
        assert!((figures.network.mean - figures.as_deep_as_wide.mean).abs() < 0.01, "{figures:?}");
        assert!((figures.network.mean - figures.mirrored_in_depth.mean).abs() < 0.01);
        assert_eq!((figures.pictures, figures.solids, figures.factor), (6, 3, 1.0));
        assert!(figures.best_tilt.mean >= figures.as_deep_as_wide.mean - 0.02);
        assert!((figures.scaled.mean - figures.network.mean).abs() < 1e-9 && figures.scales == [1.0, 1.0]);
        let best = comparison.figures(comparison.choice());
        assert!(best.as_deep_as_wide.mean >= figures.as_deep_as_wide.mean && best.scaled.mean >= figures.scaled.mean);
    }

    #[test]
    fn errors_are_those_of_groups() {
        // groups with the means 1 and 3: their deviation is √2, that of their mean 1
        let found = estimate([(0, 0.0), (0, 2.0), (4, 3.0)].into_iter());
        assert!((found.mean - 5.0 / 3.0).abs() < 1e-12 && (found.error - 1.0).abs() < 1e-12);
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
    }
}
