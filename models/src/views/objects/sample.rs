//! One placed object, rendered by all cameras.

use gradreel::{Error, ErrorKind, Key, Result};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{Object, Placement, View};
use crate::views::{Detection, ImageBox, Ring};

/// Placement and rendering of training objects.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampleSettings {
    /// Range of an object's longest side, in units of the model (the cube has side 1).
    pub scale: [f64; 2],
    /// Spread of the objects' positions: 0 centred, 1 up to the limit of full visibility in all cameras.
    pub reach: f64,
    /// Range of the input camera's elevation \[°\].
    pub elevation_deg: [f64; 2],
    /// Rays per pixel along each side.
    pub rays: usize,
    /// Grid nodes along an object's longest side.
    pub nodes: usize,
}

impl Default for SampleSettings {
    /// Scales from a quarter to about a half, full spread, the input at the ring's elevation.
    fn default() -> Self {
        Self { scale: [0.25, 0.55], reach: 1.0, elevation_deg: [30.0, 30.0], rays: 2, nodes: 48 }
    }
}

impl SampleSettings {
    /// Validates the settings.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming the invalid setting.
    pub fn check(&self) -> Result<()> {
        let ordered = |[low, high]: [f64; 2], least: f64, most: f64| least <= low && low <= high && high <= most;
        for (name, fits, wanted) in [
            ("scale", ordered(self.scale, 0.05, 1.0), "least and greatest, 0.05 to 1"),
            ("reach", (0.0..=1.0).contains(&self.reach), "0 to 1"),
            ("elevation_deg", ordered(self.elevation_deg, -80.0, 80.0), "least and greatest, −80 to 80 degrees"),
            ("rays", (1..=8).contains(&self.rays), "1 to 8"),
            ("nodes", (8..=256).contains(&self.nodes), "8 to 256"),
        ] {
            if !fits {
                return Err(Error::new(ErrorKind::Input, "objects cannot be filmed like this")
                    .at(format!("data.{name}"))
                    .found(format!("{self:?}"))
                    .wanted(wanted)
                    .fix("correct the configuration"));
            }
        }
        Ok(())
    }
}

/// A placed object, in the views of a ring and in the input image.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// One view per camera.
    pub views: Vec<View>,
    /// The input image; equal to the first view if the cameras coincide.
    pub input: View,
    /// Elevation of the input image's camera in radians.
    pub elevation: f64,
    /// Position and scale of the object.
    pub placement: Placement,
}

impl Sample {
    /// The sample of a key with a procedural object, in images of `size²` pixels.
    pub fn draw(key: Key, ring: &Ring, size: usize, settings: &SampleSettings) -> Self {
        Self::of(&Object::new(Self::object_key(key), settings.nodes), key, ring, size, settings)
    }

    /// The key of the object in a sample.
    pub fn object_key(key: Key) -> Key {
        let [object, _, _] = key.split();
        object
    }

    /// A given object placed by the key of a sample, in images of `size²` pixels.
    pub fn of(object: &Object, key: Key, ring: &Ring, size: usize, settings: &SampleSettings) -> Self {
        let [_, place, above] = key.split();
        let placement = Placement::draw(place, object.half(), ring, settings.scale, settings.reach);
        let [low, high] = settings.elevation_deg;
        let chance = above.uniform(1).next().expect("one number");
        let elevation = (low + (high - low) * chance).to_radians();
        let seen = |pose: [[f64; 4]; 3]| object.seen(&placement, &pose, ring.focal, size, settings.rays);
        let views: Vec<View> = (0..ring.views).into_par_iter().map(|view| seen(ring.pose(view))).collect();
        // conversion from degrees rounds
        let same = (elevation - ring.elevation).abs() < 1e-9;
        let elevation = if same { ring.elevation } else { elevation };
        let input = if same { views[0].clone() } else { seen(ring.input_pose(elevation)) };
        Self { views, input, elevation, placement }
    }

    /// Ground-truth detection: the object's box in the input image, and the depth of its centre in the input camera
    /// of a ring.
    pub fn seen(&self, ring: &Ring) -> Option<Detection> {
        let bounds = ImageBox::of_coverage(&self.input.coverage, self.input.size)?;
        let [_, _, depth] = ring.project(&ring.input_pose(self.elevation), self.placement.shift, 1);
        Some(Detection { bounds, depth: Some(depth) })
    }
}
