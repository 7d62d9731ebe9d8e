//! Attention of every view to the epipolar lines in its neighbours (eq. 1 of the paper).

use gradreel::ops::{Conv, GridSampling, Interpolation, Padding};
use gradreel::{Result, Tensor, Var};

use super::region::NEAR;
use super::{SpatialAwareSizes, places_in};
use crate::layers::{Init, Scope, Segment};
use crate::views::{Ring, constant};

/// Places of −1 and 1 are the centres of the first and the last cell.
pub(super) const ALIGNED: GridSampling =
    GridSampling { interpolation: Interpolation::Linear, padding: Padding::Zeros, align_corners: true };

/// What is added to the score of a sample that must not count.
const NEVER: f64 = -3e4;

/// Bytes of keys and values that are made at once.
const AT_ONCE: usize = 64 << 20;

/// The epipolar lines of all cells of one view in another: samples of the ray behind each cell, projected into the other
/// view.
#[derive(Debug, Clone, PartialEq)]
pub struct EpipolarLines {
    /// Columns and rows in cells of the other map, in the order sample, row, column.
    pub places: Vec<[f64; 2]>,
    /// Whether a sample lies within the cube of voxels and within the other map.
    pub valid: Vec<bool>,
}

impl EpipolarLines {
    /// The lines of `view` in `other`, for maps of `width²` cells and so many samples from the near to the far end.
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

/// The attention. Its query is the cell's feature, its keys are what the other view has along the line, with the place on
/// the line told, and its values are what the other view has there.
pub struct EpipolarAttention {
    maps: Segment<Maps>,
    out: Segment<Var>,
    sizes: SpatialAwareSizes,
}

/// Square maps of the features, without constant terms.
struct Maps {
    query: Var,
    key: Var,
    depth: Var,
}

/// A square map applied to every cell.
#[track_caller]
fn pointwise(x: &Var, weight: &Var) -> Var {
    let [outputs, inputs] = weight.dims()[..] else { panic!("a map is [outputs, inputs]") };
    x.conv(&weight.to_dtype(x.dtype()).reshape([outputs, inputs, 1, 1]), None, &Conv::new())
}

impl EpipolarAttention {
    /// The attention at a scope.
    ///
    /// # Errors
    /// When a weight is missing or mis-shaped.
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

    /// Features `[b, views, f, w, w]` to features of the same shape, each with what was found in the neighbours added.
    ///
    /// # Errors
    /// When places cannot be moved where the features are.
    ///
    /// # Panics
    /// When the sizes are not those of the attention.
    #[track_caller]
    pub fn forward(&self, ring: &Ring, features: &Var) -> Result<Var> {
        let [batch, views, channels, height, width] = features.dims()[..] else {
            panic!("features are [b, views, f, w, w], not {}", features.shape())
        };
        let bytes = batch * 2 * channels * self.sizes.samples * height * width * size_of::<f32>();
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

    /// What some of the views find, the mean over those neighbours in which they see anything: `[b, group, f, w, w]`.
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
        // how many neighbours each cell finds anything in
        let meets = |line: &EpipolarLines, cell: usize| (0..samples).any(|s| line.valid[s * cells + cell]);
        let met = |view: usize, cell: usize| lines.iter().filter(|of| meets(&of[view], cell)).count();
        let mut total: Option<Var> = None;
        for (offset, lines) in self.offsets(views).into_iter().zip(&lines) {
            let share = |i: usize| {
                let (view, cell) = (i / cells, i % cells);
                if meets(&lines[view], cell) { 1.0 / met(view, cell) as f64 } else { 0.0 }
            };
            let places = lines.iter().flat_map(|of| places_in(of.places.iter().copied(), width)).collect();
            let never = lines.iter().flat_map(|of| of.valid.iter().map(|valid| if *valid { 0.0 } else { NEVER }));
            let shares: Vec<f64> = (0..count * cells).map(share).collect();
            let operands = [
                features.clone(),
                constant(features, Tensor::from_vec(places, [1, count, samples, height, width, 2]))?,
                constant(
                    features,
                    Tensor::from_vec(never.collect::<Vec<f64>>(), [1, count, 1, samples, height, width]),
                )?,
                constant(features, Tensor::from_vec(shares, [1, count, 1, height, width]))?,
                self.encoding(features)?,
            ];
            let (heads, first) = (self.sizes.heads, group.start);
            let operands: Vec<&Var> = operands.iter().collect();
            let part = self.maps.run(&operands, move |maps, inputs| {
                let [features, places, never, shares, encoding] = inputs else { unreachable!("five operands") };
                let all = batch * count;
                let [own, other] = [first, first + offset]
                    .map(|first| ring_slice(features, first % views, count).reshape([all, channels, height, width]));
                let each = channels / heads;
                let line = [all, heads, each, samples, height, width];
                let one = [all, heads, 1, samples, height, width];
                let query = pointwise(&own, &maps.query).reshape([all, heads, each, height, width]);
                // a constant channel of the query carries what is added to the scores
                let query = query.concat(&[&(&(&query.slice(2, 0..1) * 0.0) + 1.0)], 2);
                let places = places
                    .broadcast_to([batch, count, samples, height, width, 2])
                    .reshape([all, samples, height, width, 2]);
                let sampled = pointwise(&other, &maps.key).concat(&[&other], 1).grid_sample(&places, ALIGNED);
                let told = encoding.linear(&maps.depth.to_dtype(encoding.dtype()), None).permute(&[1, 0]);
                let keys = &sampled.slice(1, 0..channels) + &told.reshape([1, channels, samples, 1, 1]);
                let never = never
                    .reshape([1, count, 1, 1, samples, height * width])
                    .broadcast_to([batch, count, heads, 1, samples, height * width])
                    .reshape(one);
                let keys = keys.reshape(line).concat(&[&never], 2);
                let values = sampled.slice(1, channels..2 * channels).reshape(line).concat(&[&(&never * 0.0)], 2);
                let found = query.depth_attention(&keys, &values, (each as f64).powf(-0.5)).slice(2, 0..each);
                &found.reshape([batch, count, channels, height, width]) * shares
            })?;
            total = Some(total.map_or(part.clone(), |sum| &sum + &part));
        }
        Ok(total.expect("there are neighbours"))
    }

    /// How far round the ring each neighbour is; none twice, and not the view itself.
    fn offsets(&self, views: usize) -> Vec<usize> {
        let mut offsets: Vec<usize> =
            self.sizes.neighbours.iter().map(|offset| offset.rem_euclid(views as i64) as usize).collect();
        offsets.retain(|offset| *offset > 0);
        offsets.sort_unstable();
        offsets.dedup();
        if offsets.is_empty() { vec![0] } else { offsets }
    }

    /// Where on the line each sample is: `[samples, 2 octaves]`, pairs of sine and cosine of growing
    /// frequency.
    fn encoding(&self, like: &Var) -> Result<Var> {
        let (samples, octaves) = (self.sizes.samples, self.sizes.octaves);
        let last = (samples - 1).max(1) as f64;
        let values = (0..samples * octaves).flat_map(|i| {
            let frequency = 2f64.powi((i % octaves) as i32) * std::f64::consts::PI;
            let (sine, cosine) = (frequency * (i / octaves) as f64 / last).sin_cos();
            [sine, cosine]
        });
        constant(like, Tensor::from_vec(values.collect::<Vec<f64>>(), [samples, 2 * octaves]))
    }
}

/// `count` views from `first` on, round the ring.
#[track_caller]
fn ring_slice(x: &Var, first: usize, count: usize) -> Var {
    let views = x.dims()[1];
    let end = first + count;
    if end <= views {
        return x.slice(1, first..end);
    }
    x.slice(1, first..views).concat(&[&x.slice(1, 0..end - views)], 1)
}
