//! Attention of every view to its epipolar lines in neighbouring views (eq. 1 of the paper).

use gradreel::ops::{Conv, GridSampling, Interpolation, Padding};
use gradreel::{Result, Tensor, Var};

use super::region::NEAR;
use super::{SpatialAwareSizes, places_in};
use crate::layers::{Init, Scope, Segment};
use crate::views::{Ring, constant};

/// Coordinates −1 and 1 are the centres of the first and the last cell.
pub(super) const ALIGNED: GridSampling =
    GridSampling { interpolation: Interpolation::Linear, padding: Padding::Zeros, align_corners: true };

/// Added to the score of an invalid sample.
const NEVER: f64 = -3e4;

/// Memory of the samples that are processed at once \[bytes\].
const AT_ONCE: usize = 64 << 20;

/// The epipolar lines in another view of all cells of one view: samples of the ray through each cell, projected
/// into the other view.
#[derive(Debug, Clone, PartialEq)]
pub struct EpipolarLines {
    /// Columns and rows in cells of the other map, in the order sample, row, column.
    pub places: Vec<[f64; 2]>,
    /// Whether a sample lies within the cube of voxels and the other map.
    pub valid: Vec<bool>,
}

impl EpipolarLines {
    /// The lines of `view` in `other`, for maps of `width²` cells and `samples` samples from near to far.
    pub fn new(ring: &Ring, [view, other]: [usize; 2], samples: usize, width: usize) -> Self {
        let pose = ring.pose(other);
        let last = (width - 1) as f64;
        let (places, valid) = ring
            .frustum(view, samples, width)
            .map(|point| {
                let [u, v, depth] = ring.project(&pose, point, width);
                let seen = [u, v].iter().all(|x| (0.0..=last).contains(x)) && depth > NEAR;
                ([u, v], seen && point.iter().all(|x| x.abs() <= ring.half))
            })
            .unzip();
        Self { places, valid }
    }
}

/// Epipolar attention. Queries are the features of a cell; keys and values are the other view's features along the
/// line, keys with a positional encoding along it.
pub struct EpipolarAttention {
    maps: Segment<Maps>,
    out: Segment<Var>,
    sizes: SpatialAwareSizes,
}

/// Square projection matrices of the features, without bias.
struct Maps {
    query: Var,
    key: Var,
    depth: Var,
}

impl Maps {
    /// The projections from features and positional encodings to keys, as one matrix per head:
    /// `[heads, c, features + 2 octaves]`, on the tape and in the dtype of `x`.
    #[track_caller]
    fn keys(&self, heads: usize, x: &Var) -> Var {
        let both = self.key.to_dtype(x.dtype()).concat(&[&self.depth.to_dtype(x.dtype())], 1);
        let [features, inputs] = both.dims()[..] else { unreachable!("two matrices side by side") };
        let both = both.reshape([heads, features / heads, inputs]);
        match both.value() {
            // a constant may belong to another tape; its derivatives belong to that of `x`
            Ok(value) if !both.is_differentiable() => x.tape().constant(value.clone()),
            _ => both,
        }
    }
}

/// Applies a square matrix to every cell.
#[track_caller]
fn pointwise(x: &Var, weight: &Var) -> Var {
    let [outputs, inputs] = weight.dims()[..] else { panic!("a map is [outputs, inputs]") };
    x.conv(&weight.to_dtype(x.dtype()).reshape([outputs, inputs, 1, 1]), None, &Conv::new())
}

impl EpipolarAttention {
    /// Builds the attention from the weights at a scope.
    ///
    /// # Errors
    /// If a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: &SpatialAwareSizes) -> Result<Self> {
        let (features, encoding) = (sizes.features, 2 * sizes.octaves);
        let square =
            move |scope: &Scope<'_>, name: &str| scope.weight(name, [features, features], Init::FanIn(features));
        Ok(Self {
            maps: Segment::new(scope, move |scope| {
                Ok(Maps {
                    query: square(scope, "q")?,
                    key: square(scope, "k")?,
                    depth: scope.weight("depth", [features, encoding], Init::FanIn(encoding))?,
                })
            })?,
            out: Segment::new(scope, move |scope| square(scope, "o"))?,
            sizes: sizes.clone(),
        })
    }

    /// Adds the attention output to features `[b, views, f, w, w]`; the shape is unchanged.
    ///
    /// # Errors
    /// If positions cannot be moved to the features' device.
    ///
    /// # Panics
    /// If the shapes do not match the sizes of the attention.
    #[track_caller]
    pub fn forward(&self, ring: &Ring, features: &Var) -> Result<Var> {
        let [batch, views, channels, height, width] = features.dims()[..] else {
            panic!("features are [b, views, f, w, w], not {}", features.shape())
        };
        let line = channels + 2 * self.sizes.octaves + 1;
        let bytes = batch * line * self.sizes.samples * height * width * size_of::<f32>();
        let at_once = (AT_ONCE / bytes.max(1)).clamp(1, views);
        let mut groups = Vec::new();
        for first in (0..views).step_by(at_once) {
            groups.push(self.found(ring, features, first..(first + at_once).min(views))?);
        }
        let found = groups[0].concat(&groups[1..].iter().collect::<Vec<_>>(), 1);
        let flat = [batch * views, channels, height, width];
        let out = self.out.run(&[&found.reshape(flat)], |weight, inputs| pointwise(&inputs[0], weight))?;
        Ok(features + &out.reshape(features.shape().clone()))
    }

    /// Attention output of some views, the mean over those neighbours in which each cell has valid samples:
    /// `[b, group, f, w, w]`.
    #[track_caller]
    fn found(&self, ring: &Ring, features: &Var, group: std::ops::Range<usize>) -> Result<Var> {
        let [batch, views, channels, height, width] = features.dims()[..] else { unreachable!("checked before") };
        let (count, samples, cells) = (group.len(), self.sizes.samples, height * width);
        let lines: Vec<Vec<EpipolarLines>> = self
            .offsets(views)
            .iter()
            .map(|offset| {
                let of = |view: usize| EpipolarLines::new(ring, [view, (view + offset) % views], samples, width);
                group.clone().map(of).collect()
            })
            .collect();
        // number of neighbours in which each cell has valid samples
        let meets = |line: &EpipolarLines, cell: usize| (0..samples).any(|s| line.valid[s * cells + cell]);
        let met = |view: usize, cell: usize| lines.iter().filter(|of| meets(&of[view], cell)).count();
        let encoding = self.encoding();
        let mut total: Option<Var> = None;
        for (offset, lines) in self.offsets(views).into_iter().zip(&lines) {
            let share = |i: usize| {
                let (view, cell) = (i / cells, i % cells);
                if meets(&lines[view], cell) { 1.0 / met(view, cell) as f64 } else { 0.0 }
            };
            let places = lines.iter().flat_map(|of| places_in(of.places.iter().copied(), width)).collect();
            let shares: Vec<f64> = (0..count * cells).map(share).collect();
            let operands = [
                features.clone(),
                constant(features, Tensor::from_vec(places, [1, count, samples, height, width, 2]))?,
                constant(features, self.told(&encoding, lines, [height, width]))?,
                constant(features, Tensor::from_vec(shares, [1, count, 1, height, width]))?,
            ];
            let (heads, first) = (self.sizes.heads, group.start);
            let operands: Vec<&Var> = operands.iter().collect();
            let part = self.maps.run(&operands, move |maps, inputs| {
                let [features, places, told, shares] = inputs else { unreachable!("four operands") };
                let (all, each) = (batch * count, channels / heads);
                let [own, other] = [first, first + offset]
                    .map(|first| ring_slice(features, first % views, count).reshape([all, channels, height, width]));
                // q · (K f + D γ) = (Kᵀ q) · f + (Dᵀ q) · γ avoids computing keys for the many samples, and all
                // heads share them
                let query = pointwise(&own, &maps.query).reshape([all, heads, each, cells]);
                let asked = maps.keys(heads, &query).transposed_matmul(&query);
                // one extra channel carries the score offset
                let one = constant_channel(&asked, 1.0);
                let asked = asked.concat(&[&one], 2);
                let line = asked.dims()[2];
                let places = places
                    .broadcast_to([batch, count, samples, height, width, 2])
                    .reshape([all, samples, height, width, 2]);
                let told = told.broadcast_to([batch, count, line - channels, samples, height, width]).reshape([
                    all,
                    line - channels,
                    samples,
                    height,
                    width,
                ]);
                let along = other.grid_sample(&places, ALIGNED).concat(&[&told], 1);
                let along = along.reshape([all, 1, line, samples, height, width]);
                let asked = asked.reshape([all, heads, line, height, width]);
                let found = asked.depth_attention(&along, &along, (each as f64).powf(-0.5));
                let of = |head: usize| found.select(1, head).slice(1, head * each..(head + 1) * each);
                let of_heads: Vec<Var> = (0..heads).map(of).collect();
                let found = of_heads[0].concat(&of_heads[1..].iter().collect::<Vec<_>>(), 1);
                &found.reshape([batch, count, channels, height, width]) * shares
            })?;
            total = Some(total.map_or(part.clone(), |sum| &sum + &part));
        }
        Ok(total.expect("there are neighbours"))
    }

    /// Distinct offsets of the neighbours around the ring, without the view itself.
    fn offsets(&self, views: usize) -> Vec<usize> {
        let mut offsets: Vec<usize> =
            self.sizes.neighbours.iter().map(|offset| offset.rem_euclid(views as i64) as usize).collect();
        offsets.retain(|offset| *offset > 0);
        offsets.sort_unstable();
        offsets.dedup();
        if offsets.is_empty() { vec![0] } else { offsets }
    }

    /// Positional encoding of each sample: pairs of sine and cosine at increasing frequencies.
    fn encoding(&self) -> Vec<Vec<f64>> {
        let (samples, octaves) = (self.sizes.samples, self.sizes.octaves);
        let pair = |sample: usize, octave: usize| {
            let frequency = 2f64.powi(octave as i32) * std::f64::consts::PI;
            let (sine, cosine) = (frequency * sample as f64 / (samples - 1).max(1) as f64).sin_cos();
            [sine, cosine]
        };
        (0..samples).map(|sample| (0..octaves).flat_map(|octave| pair(sample, octave)).collect()).collect()
    }

    /// Inputs of the samples besides the features: their positional encoding and score offset,
    /// `[1, lines, 2 octaves + 1, samples, h, w]`.
    fn told(&self, encoding: &[Vec<f64>], lines: &[EpipolarLines], [height, width]: [usize; 2]) -> Tensor {
        let (cells, samples, channels) = (height * width, self.sizes.samples, 2 * self.sizes.octaves);
        let mut values = Vec::with_capacity(lines.len() * (channels + 1) * samples * cells);
        for line in lines {
            for channel in 0..channels {
                encoding.iter().for_each(|of| values.extend(std::iter::repeat_n(of[channel], cells)));
            }
            values.extend(line.valid.iter().map(|valid| if *valid { 0.0 } else { NEVER }));
        }
        Tensor::from_vec(values, [1, lines.len(), channels + 1, samples, height, width])
    }
}

/// A constant channel for every cell of `x [n, heads, c, cells]`.
#[track_caller]
fn constant_channel(x: &Var, value: f64) -> Var {
    &(&x.slice(2, 0..1).detach() * 0.0) + value
}

/// `count` views from `first` on, cyclically.
#[track_caller]
fn ring_slice(x: &Var, first: usize, count: usize) -> Var {
    let views = x.dims()[1];
    let end = first + count;
    if end <= views {
        return x.slice(1, first..end);
    }
    x.slice(1, first..views).concat(&[&x.slice(1, 0..end - views)], 1)
}
