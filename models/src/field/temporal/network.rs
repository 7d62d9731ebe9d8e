//! The networks of a temporal field.

use gradreel::{Result, Var};

use super::distances::Distances;
use super::settings::{Canonical, TemporalSettings};
use crate::constant;
use crate::field::DenseGrid;
use crate::layers::{Init, Linear, Perceptron, Scope};
use crate::render::Rays;

/// The grids and networks of a temporal field, ready for evaluation. Names follow the published implementation:
/// `feature`, `density` (optional), `timenet`, `deformation_net`, `featurenet`, `densitynet`, `rgbnet`.
pub struct TemporalNet {
    settings: TemporalSettings,
    grid: DenseGrid,
    features: Distances,
    density: Option<Var>,
    time: Option<Perceptron>,
    bend: Option<Perceptron>,
    hidden: Perceptron,
    head: Perceptron,
    colour_features: Linear,
    colour: Perceptron,
}

/// Times of frames and their embedding.
pub struct Moments {
    /// Times in 0…1, `[times, 1]`.
    times: Var,
    /// Time features, `[times, time_features]`.
    features: Option<Var>,
}

/// A field evaluated at points.
pub struct TemporalSample {
    /// Points mapped to the canonical time \[m\], `[n, 3]`.
    pub bent: Var,
    /// Features interpolated at several distances, `[n, 3 · channels]`.
    pub interpolated: Var,
    /// Hidden features, `[n, width]`.
    pub hidden: Var,
    /// Raw density, `[n]`.
    pub density: Var,
}

impl TemporalNet {
    /// The networks at a scope, over a grid.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, settings: &TemporalSettings, grid: &DenseGrid) -> Result<Self> {
        let encoded = TemporalSettings::encoded;
        let (width, channels, [x, y, z]) = (settings.width, settings.channels, grid.dims);
        let position = encoded(3, settings.position_levels);
        let (time, bend, known) = if settings.time {
            let layers = [("0", width), ("2", settings.time_features)];
            let time = Perceptron::new(&scope.at("timenet"), encoded(1, settings.time_levels), &layers)?;
            let layers = [("_time.0", width), ("_time.1", width), ("_time_out", 3)];
            let inputs = position + settings.time_features;
            let start = match settings.canonical {
                Canonical::FirstFrame => Some([Init::Zeros; 2]),
                Canonical::Free => None,
            };
            let bend = Perceptron::ending_in(&scope.at("deformation_net"), inputs, &layers, start)?;
            (Some(time), Some(bend), settings.time_features)
        } else {
            (None, None, 0)
        };
        let values = scope.weight("feature", [x, y, z, channels], Init::Zeros)?;
        let features = Distances::new(grid, &values)?;
        let mut density = None;
        let mut last = None;
        if settings.explicit_density {
            density = Some(scope.weight("density", [x, y, z, 1], Init::Zeros)?);
            last = Some([Init::Zeros; 2]);
        }
        let merged = if settings.merged { position + known } else { 0 };
        let inputs = encoded(3 * channels, settings.feature_levels) + merged;
        let view = encoded(3, settings.view_levels);
        let colours = scope.at("rgbnet");
        Ok(Self {
            settings: settings.clone(),
            grid: grid.clone(),
            features,
            density,
            time,
            bend,
            hidden: Perceptron::new(&scope.at("featurenet"), inputs, &[("0", width)])?,
            head: Perceptron::ending_in(scope, width, &[("densitynet", 1)], last)?,
            colour_features: Linear::new(&colours.at("feature_linears"), width, width)?,
            colour: Perceptron::new(&colours.at("views_linears"), width + view, &[("0", width / 2), ("2", 3)])?,
        })
    }

    /// Embeds times in 0…1, in the type and on the device of `beside`.
    ///
    /// # Errors
    /// Propagates errors of the ops.
    pub fn moments(&self, beside: &Var, times: &[f64]) -> Result<Moments> {
        let times = constant::numbers(beside, times.to_vec(), [times.len(), 1])?;
        let encoded = times.positional_encoding(self.settings.time_levels);
        Ok(Moments { features: self.time.as_ref().map(|net| net.forward(&encoded)), times })
    }

    /// Encoded points, normalised to −1…1 over the box if the settings ask for it.
    fn encoded(&self, points: &Var) -> Result<Var> {
        let points = if self.settings.normalised {
            let (low, high) = (self.grid.low, self.grid.high);
            let centre = constant::numbers(points, [0, 1, 2].map(|a| (low[a] + high[a]) / 2.0).to_vec(), [3])?;
            let inverse = constant::numbers(points, [0, 1, 2].map(|a| 2.0 / (high[a] - low[a])).to_vec(), [3])?;
            &(points - &centre) * &inverse
        } else {
            points.clone()
        };
        Ok(points.positional_encoding(self.settings.position_levels))
    }

    /// The offsets `x' − x` \[m\], from encoded points, their time features and times.
    fn offset(&self, net: &Perceptron, encoded: &Var, known: &Var, times: &Var) -> Result<Var> {
        let mut offset = net.forward(&encoded.concat(&[known], 1));
        if self.settings.canonical == Canonical::FirstFrame {
            offset = offset * times;
        }
        if self.settings.normalised {
            let half = [0, 1, 2].map(|axis| (self.grid.high[axis] - self.grid.low[axis]) / 2.0);
            offset = &offset * &constant::numbers(encoded, half.to_vec(), [3])?;
        }
        Ok(offset)
    }

    /// Evaluates the field at points `[n, 3]` \[m\]; `which` `[n]` holds the index of each point's time in `moments`.
    ///
    /// # Errors
    /// Propagates errors of the ops.
    pub fn at(&self, points: &Var, moments: &Moments, which: &Var) -> Result<TemporalSample> {
        let encoded = self.encoded(points)?;
        let (mut bent, mut known) = (points.clone(), None);
        if let (Some(net), Some(features)) = (&self.bend, &moments.features) {
            let features = features.index_select(which)?;
            bent = points + &self.offset(net, &encoded, &features, &moments.times.index_select(which)?)?;
            known = Some(features);
        }
        let interpolated = self.features.lookup(&bent)?;
        let levels = interpolated.positional_encoding(self.settings.feature_levels);
        let others: Vec<&Var> = std::iter::once(&encoded).chain(&known).collect();
        let merged = if self.settings.merged { levels.concat(&others, 1) } else { levels };
        let hidden = self.hidden.forward(&merged).relu();
        let mut density = self.head.forward(&hidden);
        if let Some(values) = &self.density {
            density = density + self.grid.lookup(values, &bent)?;
        }
        let density = density.reshape([points.dims()[0]]);
        Ok(TemporalSample { bent, interpolated, hidden, density })
    }

    /// Colours `[n, 3]` in 0…1 from hidden features `[n, width]`, each seen along its ray in `ray_of`.
    ///
    /// # Errors
    /// Propagates errors of the ops.
    pub fn colours(&self, hidden: &Var, rays: &Rays, ray_of: Vec<u32>) -> Result<Var> {
        let views = constant::points(hidden, &rays.unit_directions())?.positional_encoding(self.settings.view_levels);
        let views = views.index_select(&constant::indices(hidden, ray_of)?)?;
        let features = self.colour_features.forward(hidden);
        Ok(self.colour.forward(&features.concat(&[&views], 1)).logistic())
    }
}

impl Moments {
    /// Time features `[times, time_features]`; `None` for a static field.
    pub fn features(&self) -> Option<&Var> {
        self.features.as_ref()
    }
}
