//! Sizes and switches of a temporal field.

use serde::{Deserialize, Serialize};

/// The time at which grid coordinates and world coordinates coincide.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Canonical {
    /// The first frame: `x' = x + t Δ(x, t)` is the identity at `t = 0`, where particles are seeded.
    #[default]
    FirstFrame,
    /// No particular time: `x' = x + Δ(x, t)`, as published.
    Free,
}

/// Sizes and switches of a temporal field. The default is for one CPU; [`TemporalSettings::published`] is TiNeuVox-S.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TemporalSettings {
    /// Whether the field depends on time. Without, it is one static field for all frames (ablation of the temporal
    /// encoding).
    pub time: bool,
    /// Whether interpolated features are merged with encoded positions and the time feature before density and colour;
    /// without, time only deforms coordinates.
    pub merged: bool,
    /// The canonical time.
    pub canonical: Canonical,
    /// Whether density is an explicit grid plus a network output that starts at 0, or the network's output alone.
    pub explicit_density: bool,
    /// Whether coordinates are normalised to −1…1 over the box before encoding; offsets are then in half extents of the
    /// box.
    pub normalised: bool,
    /// Width of the networks.
    pub width: usize,
    /// Channels of the feature grid.
    pub channels: usize,
    /// Length of the time feature.
    pub time_features: usize,
    /// Frequencies of the encoding of positions.
    pub position_levels: usize,
    /// Frequencies of the encoding of times.
    pub time_levels: usize,
    /// Frequencies of the encoding of interpolated features; 0 passes them unencoded.
    pub feature_levels: usize,
    /// Frequencies of the encoding of viewing directions.
    pub view_levels: usize,
    /// Initial opacity of a node over one unit of length.
    pub opacity: f64,
    /// Distance between samples in grid spacings.
    pub step: f64,
    /// Nearest sample, in multiples of the ray direction's length.
    pub near: f64,
    /// Farthest sample, in the same unit.
    pub far: f64,
    /// Opacities and weights up to this value are dropped.
    pub threshold: f64,
    /// A ray ends after the sample at which the transmittance falls below this value.
    pub stop: f64,
    /// Grey value of the background; 1 is white.
    pub background: f64,
}

impl Default for TemporalSettings {
    fn default() -> Self {
        Self {
            time: true,
            merged: true,
            canonical: Canonical::FirstFrame,
            explicit_density: true,
            normalised: true,
            width: 64,
            channels: 12,
            time_features: 20,
            position_levels: 6,
            time_levels: 8,
            feature_levels: 0,
            view_levels: 4,
            opacity: 1e-2,
            step: 0.5,
            near: 0.1,
            far: 1e9,
            threshold: 1e-4,
            stop: 1e-3,
            background: 1.0,
        }
    }
}

impl TemporalSettings {
    /// The small setting of J. Fang and others, "Fast Dynamic Radiance Fields with Time-Aware Neural Voxels", SIGGRAPH
    /// Asia 2022: networks of width 64 and 4 channels.
    pub fn published() -> Self {
        Self {
            canonical: Canonical::Free,
            explicit_density: false,
            normalised: false,
            channels: 4,
            position_levels: 10,
            feature_levels: 2,
            ..Self::default()
        }
    }

    /// Length of an encoded vector of `n` components.
    pub(super) fn encoded(n: usize, levels: usize) -> usize {
        n * (1 + 2 * levels)
    }
}
