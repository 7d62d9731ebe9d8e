//! Particle motion as embedded in the page: positions quantised to 16 bits within one box, as base64.

use serde_json::{Value, json};

use crate::report::base64;

/// Quantisation steps along each axis; `ABSENT` marks a particle with a non-finite position.
const STEPS: f32 = 65534.0;
const ABSENT: u16 = u16::MAX;
/// Maximum number of particles sampled to estimate the spacing.
const SAMPLE: usize = 200;

/// Particles over time, and the cameras of the clip. Lengths in metres, y up.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Positions \[m\], `[frame][particle]`; every frame has the same particles in the same order.
    pub frames: Vec<Vec<[f32; 3]>>,
    /// Colour of each particle (sRGB).
    pub colours: Vec<[u8; 3]>,
    /// Time between two frames \[s\].
    pub frame_dt: f64,
    /// Height of the ground \[m\].
    pub ground: f32,
    /// Camera-to-world matrices with OpenGL axes (x right, y up, looking along −z) \[m\].
    pub cameras: Vec<[[f64; 4]; 3]>,
}

impl Scene {
    /// JSON input of the player. Non-finite numbers become `null`, which the player skips.
    #[track_caller]
    pub(super) fn data(&self) -> Value {
        for (i, frame) in self.frames.iter().enumerate() {
            let (found, wanted) = (frame.len(), self.colours.len());
            assert_eq!(found, wanted, "frame {i} has {found} particles, but there are {wanted} colours");
        }
        let (low, extent) = self.bounds();
        let steps = self.frames.iter().flatten().flat_map(|&p| quantise(p, low, extent));
        let positions: Vec<u8> = steps.flat_map(u16::to_le_bytes).collect();
        json!({
            "frames": self.frames.len(),
            "particles": self.colours.len(),
            "dt": self.frame_dt,
            "ground": self.ground,
            "low": low,
            "extent": extent,
            "spacing": self.spacing(),
            "absent": self.frames.iter().flatten().filter(|p| !finite(p)).count(),
            "positions": base64::encode(&positions),
            "colours": base64::encode(self.colours.as_flattened()),
            "cameras": self.cameras,
        })
    }

    /// Lower corner and edge lengths \[m\] of the bounding box of all finite positions over all frames.
    fn bounds(&self) -> ([f32; 3], [f32; 3]) {
        let mut corners: Option<([f32; 3], [f32; 3])> = None;
        for p in self.frames.iter().flatten().filter(|p| finite(p)) {
            let (low, high) = corners.get_or_insert((*p, *p));
            for axis in 0..3 {
                low[axis] = low[axis].min(p[axis]);
                high[axis] = high[axis].max(p[axis]);
            }
        }
        let (low, high) = corners.unwrap_or(([0.0; 3], [0.0; 3]));
        (low, [0, 1, 2].map(|axis| high[axis] - low[axis]))
    }

    /// Median distance \[m\] from a particle to its nearest neighbour in the first frame; 0 for fewer than two.
    fn spacing(&self) -> f32 {
        let Some(first) = self.frames.first() else { return 0.0 };
        let points: Vec<[f32; 3]> = first.iter().copied().filter(finite).collect();
        let stride = points.len().div_ceil(SAMPLE).max(1);
        let mut nearest: Vec<f32> = Vec::new();
        for (i, p) in points.iter().enumerate().step_by(stride) {
            let others = points.iter().enumerate().filter(|&(j, _)| j != i);
            let squares = others.map(|(_, q)| (0..3).map(|a| (p[a] - q[a]).powi(2)).sum::<f32>());
            nearest.extend(squares.reduce(f32::min).map(f32::sqrt));
        }
        nearest.sort_by(f32::total_cmp);
        nearest.get(nearest.len() / 2).copied().unwrap_or(0.0)
    }
}

fn finite(p: &[f32; 3]) -> bool {
    p.iter().all(|x| x.is_finite())
}

/// `round(65534 (p − low) / extent)` per axis; all axes at 65535 where the position is not finite.
fn quantise(p: [f32; 3], low: [f32; 3], extent: [f32; 3]) -> [u16; 3] {
    if !finite(&p) {
        return [ABSENT; 3];
    }
    [0, 1, 2].map(|axis| match extent[axis] > 0.0 {
        true => ((p[axis] - low[axis]) / extent[axis] * STEPS).round() as u16,
        false => 0,
    })
}
