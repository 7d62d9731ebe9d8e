//! Mattes by a network that is given as an ONNX file.

use std::path::PathBuf;

use gradreel::Result;
use serde::{Deserialize, Serialize};

use super::resample;
use super::runtime::{self, Network, SIDES};
use crate::video::image::Image;
use crate::video::mask::Mask;

/// Where a network leaves the size of its pictures open, their sides are multiples of this: networks halve them five times.
const MULTIPLE: usize = 32;

/// How far beyond 0 and 1 values are still shares: filters at the end of a network overshoot a little.
const OVERSHOOT: f32 = 0.25;

/// A network that tells the object from the background of a picture, such as U²-Net, ISNet, RMBG, BiRefNet or MODNet.
///
/// It takes one picture `[1, 3, height, width]` of `f32`, and its first output is `[1, 1, height, width]` or `[1, height, width]`: the
/// object's share of each pixel. Values beyond 0 to 1 are taken for logits if some are negative, and made shares by the logistic
/// function; otherwise they are stretched to 0 to 1, picture by picture. The file is run as a program is: it takes the time and the memory that
/// it asks for.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MattingSettings {
    /// The ONNX file, weights included.
    pub model: PathBuf,
    /// What is subtracted from red, green and blue, each from 0 to 1. The default is that of U²-Net and BiRefNet; of ISNet, RMBG-1.4
    /// and MODNet it is 0.5.
    pub mean: [f64; 3],
    /// What the difference is divided by. The default is that of U²-Net and BiRefNet; of ISNet and RMBG-1.4 it is 1, of MODNet 0.5.
    pub deviation: [f64; 3],
    /// Longer side of the pictures that the network sees, where it leaves their size open \[pixels\]; sides become multiples of 32.
    pub size: usize,
}

impl Default for MattingSettings {
    fn default() -> Self {
        Self { model: PathBuf::new(), mean: [0.485, 0.456, 0.406], deviation: [0.229, 0.224, 0.225], size: 512 }
    }
}

impl MattingSettings {
    /// Whether the values make sense: each rule with the setting that it is about, and what is wanted.
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

    /// Width and height of the pictures that a network sees of a film, if it leaves them open.
    fn open(&self, film: [usize; 2]) -> [usize; 2] {
        let longer = film[0].max(film[1]) as f64;
        film.map(|side| {
            let multiples = side as f64 / longer * self.size as f64 / MULTIPLE as f64;
            MULTIPLE * (multiples.round() as usize).max(1)
        })
    }
}

/// The masks of pictures of one size, white where the network sees the object, and what there is to say of it.
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

/// What the numbers of a network are.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Scale {
    Shares,
    Logits,
    Other,
}

/// The mask of a picture, and what the network's numbers were.
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
        // 0 where all values are the same
        Scale::Other => (value - low) / (high - low).max(f32::MIN_POSITIVE),
    };
    let shares: Vec<f32> = values.into_iter().map(share).collect();
    let coverage = resample::resized(&shares, sides, film).into_iter().map(|share| (255.0 * share).round() as u8);
    Ok((Mask { width: image.width, height: image.height, coverage: coverage.collect() }, scale))
}
