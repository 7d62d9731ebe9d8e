//! Mattes by a given ONNX network.

use std::path::PathBuf;

use gradreel::Result;
use serde::{Deserialize, Serialize};

use super::resample;
use super::runtime::{self, Network, SIDES};
use crate::video::image::Image;
use crate::video::mask::Mask;

/// Side lengths are multiples of this where a network leaves its input size open: networks halve them five times.
const MULTIPLE: usize = 32;

/// Tolerated overshoot of coverage values beyond 0 and 1, caused by the filters at a network's output.
const OVERSHOOT: f32 = 0.25;

/// A network that segments the object in a picture, such as U²-Net, ISNet, RMBG, BiRefNet or MODNet.
///
/// The input is one picture `[1, 3, height, width]` of `f32`; the first output is the object's coverage
/// `[1, 1, height, width]` or `[1, height, width]`. Values outside 0…1 are taken as logits if some are negative and
/// passed through the logistic function; otherwise they are rescaled to 0…1 per picture. Running a network takes the
/// time and memory that its file demands.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MattingSettings {
    /// The ONNX file, weights included.
    pub model: PathBuf,
    /// Subtracted from red, green and blue, each in 0…1. The default is that of U²-Net and BiRefNet; use 0.5 for
    /// ISNet, RMBG-1.4 and MODNet.
    pub mean: [f64; 3],
    /// Divisor of the difference. The default is that of U²-Net and BiRefNet; use 1 for ISNet and RMBG-1.4, 0.5 for
    /// MODNet.
    pub deviation: [f64; 3],
    /// Longer side of the network's input where it leaves the size open \[pixels\]; sides are rounded to multiples
    /// of 32.
    pub size: usize,
}

impl Default for MattingSettings {
    fn default() -> Self {
        Self { model: PathBuf::new(), mean: [0.485, 0.456, 0.406], deviation: [0.229, 0.224, 0.225], size: 512 }
    }
}

impl MattingSettings {
    /// Validity of the settings: for each rule its result, the setting and the expected value.
    pub(super) fn rules(&self) -> [(bool, &'static str, &'static str); 4] {
        [
            (!self.model.as_os_str().is_empty(), "matting.model", "the path of an ONNX file"),
            (self.mean.iter().all(|m| m.abs() <= 1e6), "matting.mean", "three numbers, -1e6 to 1e6"),
            (
                self.deviation.iter().all(|d| (1e-6..=1e6).contains(d)),
                "matting.deviation",
                "three numbers, 1e-6 to 1e6",
            ),
            (SIDES.contains(&self.size), "matting.size", "16 to 4096 pixels"),
        ]
    }

    /// Width and height of the network's input, if it leaves them open.
    fn open(&self, film: [usize; 2]) -> [usize; 2] {
        let longer = film[0].max(film[1]) as f64;
        film.map(|side| {
            let multiples = side as f64 / longer * self.size as f64 / MULTIPLE as f64;
            MULTIPLE * (multiples.round() as usize).max(1)
        })
    }
}

/// Masks of equally sized pictures, white on the object, and messages about them.
pub(super) fn masks(settings: &MattingSettings, images: &[Image]) -> Result<(Vec<Mask>, Vec<String>)> {
    let path = &settings.model;
    runtime::guarded(path, || {
        let network = Network::read(path, settings.open([images[0].width, images[0].height]))?;
        let (mut masks, mut scales) = (Vec::new(), Vec::new());
        for image in images {
            let (mask, scale) = mask(&network, settings, image)?;
            masks.push(mask);
            scales.push(scale);
        }
        let [width, height] = network.sides;
        let mut said = vec![format!("the matting network is {}; it sees {width} × {height} pixels", path.display())];
        let kinds = [
            (Scale::Logits, "some are negative: they are taken for logits"),
            (Scale::Other, "they are stretched to 0 to 1, picture by picture"),
        ];
        let found = kinds.iter().filter(|(scale, _)| scales.contains(scale));
        said.extend(found.map(|(_, what)| format!("the network's values go beyond 0 to 1; {what}")));
        Ok((masks, said))
    })
}

/// Kind of a network's output values.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Scale {
    Shares,
    Logits,
    Other,
}

/// The mask of a picture, and the kind of the network's output.
fn mask(network: &Network<'_>, settings: &MattingSettings, image: &Image) -> Result<(Mask, Scale)> {
    let film = [image.width, image.height];
    let plane = |c: usize| {
        let channel: Vec<f32> = image.pixels.iter().map(|pixel| f32::from(pixel[c]) / 255.0).collect();
        let (mean, deviation) = (settings.mean[c] as f32, settings.deviation[c] as f32);
        resample::resized(&channel, film, network.sides).into_iter().map(move |value| (value - mean) / deviation)
    };
    let (sides, values) = network.run((0..3).flat_map(plane).collect())?;
    let [low, high] = [f32::min, f32::max].map(|of| values.iter().copied().reduce(of).unwrap_or(0.0));
    let scale = match low < -OVERSHOOT {
        true => Scale::Logits,
        false if high > 1.0 + OVERSHOOT => Scale::Other,
        false => Scale::Shares,
    };
    let share = |value: f32| match scale {
        Scale::Shares => value.clamp(0.0, 1.0),
        Scale::Logits => 1.0 / (1.0 + (-value).exp()),
        // 0 where all values are equal
        Scale::Other => (value - low) / (high - low).max(f32::MIN_POSITIVE),
    };
    let shares: Vec<f32> = values.into_iter().map(share).collect();
    let coverage = resample::resized(&shares, sides, film).into_iter().map(|share| (255.0 * share).round() as u8);
    Ok((Mask { width: image.width, height: image.height, coverage: coverage.collect() }, scale))
}
