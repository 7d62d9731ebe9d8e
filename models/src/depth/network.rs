//! The network: a U-Net from the features of a masked picture to its two depth layers.

use gradreel::{Error, ErrorKind, Result, Tensor, Var};
use serde::{Deserialize, Serialize};

use super::features::{CHANNELS, HALF, MASK};
use super::picture::SIZE;
use crate::layers::{Convolution, GroupNorm, Init, Kernel, Scope};

/// Sizes of the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DepthSizes {
    /// Channels at a half, a quarter, an eighth and a sixteenth of the picture's side; multiples of 8.
    pub channels: [usize; 4],
    /// Residual blocks on the way down at each of them.
    pub blocks: [usize; 4],
}

impl Default for DepthSizes {
    /// 1.8 million numbers.
    fn default() -> Self {
        Self { channels: [32, 64, 96, 160], blocks: [1, 1, 2, 2] }
    }
}

impl DepthSizes {
    /// Metadata key of the sizes in a file of weights.
    pub const METADATA: &str = "gradreel.depth";

    /// Validates the sizes.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] naming what is wrong.
    pub fn check(&self) -> Result<()> {
        let channels = self.channels.iter().all(|c| (8..=1024).contains(c) && c % GROUP == 0);
        let blocks = self.blocks.iter().all(|count| (1..=16).contains(count));
        if channels && blocks {
            return Ok(());
        }
        Err(Error::new(ErrorKind::Input, "the sizes of the depth network make no sense")
            .at("model")
            .found(format!("{self:?}"))
            .wanted("multiples of 8 from 8 to 1024 as channels, 1 to 16 blocks")
            .fix("correct the configuration"))
    }

    pub(crate) fn to_json(self) -> String {
        serde_json::to_string(&self).expect("sizes are numbers")
    }

    pub(crate) fn from_json(text: &str) -> Result<Self> {
        let refused = |e| {
            Error::new(ErrorKind::Input, "the sizes of the depth network cannot be read").at(Self::METADATA).found(e)
        };
        let sizes: Self = serde_json::from_str(text).map_err(refused)?;
        sizes.check().map(|()| sizes)
    }
}

/// Channels that are normalised together.
const GROUP: usize = 8;
const EPSILON: f64 = 1e-5;
/// Initial scale of what a residual block adds.
const ADDED: f64 = 0.3;
/// Initial logarithm of the errors, in diameters.
const LOG_ERROR: f64 = -2.0;
/// Factors that bring the features near 1: of colours, silhouette, half thickness and place.
const SCALES: [f32; CHANNELS] = [1.0, 1.0, 1.0, 1.0, 4.0, 2.0, 2.0];
/// Thickness that is added to the weight of the middle \[D\].
const THIN: f64 = 0.01;

/// What the network says of a batch of pictures: maps `[b, SIZE, SIZE]`, in diameters.
pub(crate) struct Prediction {
    pub front: Var,
    pub back: Var,
    /// Logarithms of the mean absolute errors of both.
    pub log_errors: [Var; 2],
    /// Change of the front per diameter to the right and downwards, in squares of 2×2 pixels: `[b, 2, SIZE/2, SIZE/2]`.
    pub slopes: Var,
}

/// A residual block: `x + GN(conv(silu(GN(conv(x)))))`.
struct Block {
    convolutions: [Convolution; 2],
    norms: [GroupNorm; 2],
}

impl Block {
    fn new(scope: &Scope<'_>, channels: usize) -> Result<Self> {
        let convolution =
            |name: &str| Convolution::new(&scope.at(name), Kernel::image(channels, channels, 3).without_bias());
        let norm = |name: &str, scale| GroupNorm::scaled(&scope.at(name), channels / GROUP, channels, EPSILON, scale);
        Ok(Self {
            convolutions: [convolution("conv1")?, convolution("conv2")?],
            norms: [norm("norm1", Init::Ones)?, norm("norm2", Init::Constant(ADDED))?],
        })
    }

    #[track_caller]
    fn forward(&self, x: &Var) -> Var {
        let h = self.norms[0].silu(&self.convolutions[0].forward(x));
        x + self.norms[1].forward(&self.convolutions[1].forward(&h))
    }
}

/// The U-Net: pixels in squares of 2×2 as channels, four levels on the way down, three on the way up with what was there added.
///
/// Depths are said as differences to the body that is as deep as wide; their common shift, which no picture tells, is such that
/// the middle weighted by thickness is at 0.
pub(crate) struct DepthNet {
    stem: Convolution,
    encoder: Vec<Vec<Block>>,
    down: Vec<Convolution>,
    up: Vec<Convolution>,
    decoder: Vec<Block>,
    head: Convolution,
}

/// Channels of the head: four maps in squares of 2×2, and two slopes.
const MAPS: usize = 16;
const HEAD: usize = MAPS + 2;

impl DepthNet {
    /// The network at a scope.
    ///
    /// # Errors
    /// When a weight is missing or has the wrong shape.
    pub fn new(scope: &Scope<'_>, sizes: &DepthSizes) -> Result<Self> {
        let DepthSizes { channels, blocks } = sizes;
        let level = |level: usize| -> Result<Vec<Block>> {
            let scope = scope.at("encoder").at(level);
            (0..blocks[level]).map(|block| Block::new(&scope.at(block), channels[level])).collect()
        };
        let square = |from: usize, to: usize| Kernel::image(channels[from], channels[to], 2).stride(2).padding(0);
        Ok(Self {
            stem: Convolution::new(&scope.at("stem"), Kernel::image(4 * CHANNELS, channels[0], 3))?,
            encoder: (0..4).map(level).collect::<Result<_>>()?,
            down: (0..3)
                .map(|level| Convolution::new(&scope.at("down").at(level), square(level, level + 1)))
                .collect::<Result<_>>()?,
            up: (0..3)
                .map(|level| Convolution::transposed(&scope.at("up").at(level), square(level + 1, level)))
                .collect::<Result<_>>()?,
            decoder: (0..3)
                .map(|level| Block::new(&scope.at("decoder").at(level), channels[level]))
                .collect::<Result<_>>()?,
            head: Convolution::new(&scope.at("head"), Kernel::image(channels[0], HEAD, 3).zeros())?,
        })
    }

    /// Features `[b, CHANNELS, SIZE, SIZE]` to depths.
    ///
    /// # Panics
    /// When the features have another shape.
    #[track_caller]
    pub fn forward(&self, features: &Var) -> Prediction {
        let [batch, half] = [features.dims()[0], SIZE / 2];
        let scales = features.tape().constant(Tensor::from_vec(SCALES.to_vec(), [1, CHANNELS, 1, 1]));
        let x = features * scales;
        let x = x.reshape([batch, CHANNELS, half, 2, half, 2]).permute(&[0, 1, 3, 5, 2, 4]);
        let mut x = self.stem.forward(&x.reshape([batch, 4 * CHANNELS, half, half])).silu();
        let mut skipped = Vec::new();
        for (level, blocks) in self.encoder.iter().enumerate() {
            x = blocks.iter().fold(x, |x, block| block.forward(&x));
            if let Some(down) = self.down.get(level) {
                skipped.push(x.clone());
                x = down.forward(&x).silu();
            }
        }
        for level in (0..3).rev() {
            x = self.decoder[level].forward(&(self.up[level].forward(&x) + &skipped[level]).silu());
        }
        let said = self.head.forward(&x);
        let maps = said.slice(1, 0..MAPS).reshape([batch, 4, 2, 2, half, half]).permute(&[0, 1, 4, 2, 5, 3]);
        let maps = maps.reshape([batch, 4, SIZE, SIZE]);
        let [mask, deep] = [MASK, HALF].map(|plane| features.select(1, plane));
        let (front, back) = (maps.select(1, 0) - &deep, maps.select(1, 1) + &deep);
        let middle = middle(&front, &back, &mask);
        Prediction {
            front: front - &middle,
            back: back - &middle,
            log_errors: [2, 3].map(|map| maps.select(1, map) + LOG_ERROR),
            slopes: said.slice(1, MAPS..HEAD),
        }
    }
}

/// The middle of each body, weighted by its thickness: `[b, 1, 1]`.
fn middle(front: &Var, back: &Var, mask: &Var) -> Var {
    let weight = Var::map_n("depth_middle_weight", [front, back, mask], |[f, b, m]| ((b - f).max(0.0) + THIN) * m);
    let sum = Var::map_n("depth_middle", [front, back, &weight], |[f, b, w]| w * 0.5 * (f + b)).sum(&[1, 2]);
    let batch = front.dims()[0];
    (sum / (weight.sum(&[1, 2]) + 1e-6)).reshape([batch, 1, 1])
}

#[cfg(test)]
mod tests {
    use gradreel::{DType, Key, Tape};

    use super::*;
    use crate::layers::initialise;

    /// Before any training the network says what it was given: as deep as wide, with the middle at 0.
    #[test]
    fn it_begins_as_deep_as_wide() {
        let sizes = DepthSizes { channels: [8, 8, 16, 16], blocks: [1; 4] };
        let params = initialise(Key::new(1), DType::F32, |scope| DepthNet::new(scope, &sizes)).unwrap();
        let tape = Tape::new();
        let bound = params.bind(&tape);
        let net = DepthNet::new(&Scope::root(&bound), &sizes).unwrap();
        let mut values = vec![0.0f32; CHANNELS * SIZE * SIZE];
        for pixel in (0..SIZE * SIZE).filter(|pixel| (10..50).contains(&(pixel % SIZE)) && pixel / SIZE > 20) {
            values[MASK * SIZE * SIZE + pixel] = 1.0;
            values[HALF * SIZE * SIZE + pixel] = 0.25;
        }
        let found = net.forward(&tape.constant(Tensor::from_vec(values.clone(), [1, CHANNELS, SIZE, SIZE])));
        let front = found.front.value().unwrap().slice::<f32>().to_vec();
        let back = found.back.value().unwrap().slice::<f32>().to_vec();
        for pixel in 0..SIZE * SIZE {
            let half = values[HALF * SIZE * SIZE + pixel];
            assert!((front[pixel] + half).abs() < 1e-6 && (back[pixel] - half).abs() < 1e-6);
        }
        assert!(found.log_errors[0].value().unwrap().slice::<f32>().iter().all(|x| *x == -2.0));
        assert_eq!(found.slopes.dims(), [1, 2, SIZE / 2, SIZE / 2]);
    }

    #[test]
    fn the_default_has_the_size_it_says() {
        let params = initialise(Key::new(1), DType::F32, |scope| DepthNet::new(scope, &DepthSizes::default())).unwrap();
        assert!((1_700_000..1_900_000).contains(&params.count()), "{}", params.count());
    }

    #[test]
    fn senseless_sizes_are_refused() {
        for sizes in [
            DepthSizes { channels: [32, 64, 96, 150], ..DepthSizes::default() },
            DepthSizes { channels: [0, 64, 96, 160], ..DepthSizes::default() },
            DepthSizes { blocks: [1, 0, 1, 1], ..DepthSizes::default() },
        ] {
            assert_eq!(sizes.check().unwrap_err().kind(), ErrorKind::Input);
            assert!(DepthSizes::from_json(&sizes.to_json()).is_err());
        }
        let sizes = DepthSizes::default();
        assert_eq!(DepthSizes::from_json(&sizes.to_json()).unwrap(), sizes);
    }
}
