//! The trained network: depths of a masked picture.

use std::path::Path;

use gradreel::io::Archive;
use gradreel::optim::{Load, Params};
use gradreel::{DType, Error, ErrorKind, Key, Result, Tape, Tensor};

use super::features::{CHANNELS, Features};
use super::loss::LOG_ERRORS;
use super::network::{DepthNet, DepthSizes};
use super::picture::{PIXELS, SIZE};
use super::pose::Pose;
use super::window::{MaskedPicture, Window};
use crate::layers::{Scope, initialise};

/// A trained network, ready to predict.
///
/// ```
/// use gradreel_models::depth::{DepthNetwork, MaskedPicture};
///
/// // a grey disc, lit from above
/// let (size, radius) = (96usize, 30.0f32);
/// let place = |pixel: usize| [(pixel % size) as f32 - 48.0, (pixel / size) as f32 - 48.0];
/// let inside = |[x, y]: [f32; 2]| x.hypot(y) < radius;
/// let colours = (0..size * size).map(|pixel| [0.4 - 0.2 * place(pixel)[1] / radius; 3]).collect();
/// let coverage = (0..size * size).map(|pixel| f32::from(u8::from(inside(place(pixel))))).collect();
/// let picture = MaskedPicture::new(size, size, colours, coverage)?;
///
/// let found = DepthNetwork::built_in()?.predict(&picture)?;
/// let [front, back] = found.at(48.0, 48.0).expect("the middle is in the silhouette");
/// assert!(front < 0.0 && back > 0.0, "{front} and {back} diameters of {} pixels", found.diameter);
/// # Ok::<(), gradreel::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct DepthNetwork {
    sizes: DepthSizes,
    params: Params,
}

/// Front and back of a body, and how sure they are: maps of [`LayeredDepth::SIZE`] squared, row by row, in diameters of the disc
/// of the silhouette's area, in the camera's frame: 0 is the body's middle, positive is away from the camera. Outside the silhouette
/// all is 0.
#[derive(Debug, Clone, PartialEq)]
pub struct LayeredDepth {
    /// Depth of the nearest surface.
    pub front: Vec<f32>,
    /// Depth of the farthest surface.
    pub back: Vec<f32>,
    /// Standard deviations of both.
    pub deviations: [Vec<f32>; 2],
    /// The silhouette as the network saw it.
    pub silhouette: Vec<bool>,
    /// The diameter in pixels of the picture.
    pub diameter: f64,
    /// Where the maps lie in the picture.
    pub window: Window,
}

/// Pictures that are evaluated together.
const TOGETHER: usize = 32;

impl DepthNetwork {
    /// The path that stands for the weights that come with the crate.
    pub const BUILT_IN: &str = "built-in";

    /// The network that comes with the crate.
    ///
    /// # Errors
    /// If the weights do not belong to this version.
    pub fn built_in() -> Result<Self> {
        Self::of_archive(&Archive::from_bytes(Self::built_in_weights().to_vec())?)
    }

    /// The file of its weights: safetensors in `f16`.
    pub fn built_in_weights() -> &'static [u8] {
        // a static, so that the bytes are embedded only once
        static BYTES: &[u8] = include_bytes!("../../weights/depth.safetensors");
        BYTES
    }

    /// A network from a file that `gradreel train depth` wrote, or [`DepthNetwork::BUILT_IN`].
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a file that is missing, damaged, or not of such a network.
    pub fn open(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        if path == Self::BUILT_IN {
            return Self::built_in();
        }
        Self::of_archive(&Archive::open(path)?).map_err(|e| e.within(path.display()))
    }

    fn of_archive(archive: &Archive) -> Result<Self> {
        let Some(text) = archive.metadata().get(DepthSizes::METADATA) else {
            return Err(Error::new(ErrorKind::Input, "the file does not hold the weights of a depth network")
                .found(format!("no {} in its metadata", DepthSizes::METADATA))
                .wanted("model.safetensors of `gradreel train depth`")
                .fix("give such a file, or `built-in`"));
        };
        let sizes = DepthSizes::from_json(text)?;
        let mut params = initialise(Key::new(0), DType::F32, |scope| DepthNet::new(scope, &sizes))?;
        params.load(archive, &Load::strict())?;
        Ok(Self { sizes, params })
    }

    pub(crate) fn new(sizes: DepthSizes, params: Params) -> Self {
        Self { sizes, params }
    }

    /// The weights.
    pub(crate) fn params(&self) -> &Params {
        &self.params
    }

    /// The sizes of the network.
    pub fn sizes(&self) -> DepthSizes {
        self.sizes
    }

    /// Depths of what a silhouette shows: the mean of what the network says of the picture, of its mirror image, and of both moved
    /// by a pixel or two.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] for a silhouette of hardly any pixels.
    pub fn predict(&self, picture: &MaskedPicture) -> Result<LayeredDepth> {
        let framed = picture.framed()?;
        let features = Features::of(std::array::from_fn(|k| &*framed.colours[k]), &framed.silhouette);
        let [front, back, log_front, log_back] =
            self.layers(&[&features.planes], &Pose::ALL)?.pop().expect("one prediction for one picture");
        let inside = |mut plane: Vec<f32>| {
            plane.iter_mut().zip(&framed.silhouette).for_each(|(x, inside)| *x = if *inside { *x } else { 0.0 });
            plane
        };
        // a Laplace distribution of the mean error b has the deviation √2 b
        let deviation = |plane: Vec<f32>| inside(plane.iter().map(|s| std::f32::consts::SQRT_2 * s.exp()).collect());
        Ok(LayeredDepth {
            front: inside(front),
            back: inside(back),
            deviations: [deviation(log_front), deviation(log_back)],
            diameter: f64::from(features.diameter) * framed.window.pixel,
            silhouette: framed.silhouette,
            window: framed.window,
        })
    }

    /// Front, back and the logarithms of their mean errors for the features of each picture: means over the poses that keep the
    /// silhouette in the picture, the first of which is the picture as it is.
    pub(crate) fn layers(&self, features: &[&[f32]], poses: &[Pose]) -> Result<Vec<[Vec<f32>; 4]>> {
        let mut found = Vec::with_capacity(features.len());
        for some in features.chunks(TOGETHER) {
            let mut sums = vec![([0; 4].map(|_| vec![0.0f32; PIXELS]), 0.0f32); some.len()];
            for pose in poses {
                let taken = some.iter().enumerate().filter_map(|(k, planes)| Some((k, pose.taken(planes)?)));
                let (places, taken): (Vec<usize>, Vec<Vec<f32>>) = taken.unzip();
                if places.is_empty() {
                    continue;
                }
                let said = self.forward(&taken.iter().map(|planes| &**planes).collect::<Vec<_>>())?;
                for (place, maps) in places.into_iter().zip(said) {
                    let (sum, count) = &mut sums[place];
                    *count += 1.0;
                    for (sum, map) in sum.iter_mut().zip(maps) {
                        sum.iter_mut().zip(pose.back(map)).for_each(|(sum, x)| *sum += x);
                    }
                }
            }
            found.extend(sums.into_iter().map(|(mut sum, count)| {
                sum.iter_mut().flatten().for_each(|x| *x /= count);
                sum
            }));
        }
        Ok(found)
    }

    fn forward(&self, features: &[&[f32]]) -> Result<Vec<[Vec<f32>; 4]>> {
        let tape = Tape::new();
        let constants: Params = self.params.iter().map(|(path, weight)| (path.to_owned(), weight.clone())).collect();
        let frozen = {
            let mut frozen = constants;
            frozen.freeze("")?;
            frozen.bind(&tape)
        };
        let net = DepthNet::new(&Scope::root(&frozen), &self.sizes)?;
        let joined = features.iter().flat_map(|planes| planes.iter().copied()).collect();
        let shape = [features.len(), CHANNELS, SIZE, SIZE];
        let said = net.forward(&tape.constant(Tensor::from_vec(joined, shape)));
        let maps = [&said.front, &said.back, &said.log_errors[0], &said.log_errors[1]].map(|map| map.value());
        let [front, back, log_front, log_back] = maps;
        let (front, back) = (front?.slice::<f32>(), back?.slice::<f32>());
        let logs = [log_front?.slice::<f32>(), log_back?.slice::<f32>()];
        let [least, most] = LOG_ERRORS.map(|x| x as f32);
        let plane = |map: &[f32], k: usize| map[k * PIXELS..][..PIXELS].to_vec();
        let log = |map: &[f32], k: usize| plane(map, k).into_iter().map(|s| s.clamp(least, most)).collect();
        Ok((0..features.len()).map(|k| [plane(front, k), plane(back, k), log(logs[0], k), log(logs[1], k)]).collect())
    }
}

impl LayeredDepth {
    /// Pixels along a side of the maps.
    pub const SIZE: usize = SIZE;

    /// Front and back at a place of the picture in pixels, if it is in the silhouette.
    pub fn at(&self, x: f64, y: f64) -> Option<[f32; 2]> {
        let pixel = self.window.pixel_at(x, y)?;
        self.silhouette[pixel].then(|| [self.front[pixel], self.back[pixel]])
    }
}

#[cfg(test)]
mod tests {
    use gradreel::io::TensorFile;

    use super::*;
    use crate::depth::picture::mirror;

    const VECTORS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/vectors/depth/layers.safetensors");

    fn vectors() -> (Vec<Vec<f32>>, Vec<Vec<bool>>, TensorFile) {
        let file = TensorFile::read(VECTORS).unwrap();
        let colours = file.get("colours").unwrap().slice::<f32>().chunks(PIXELS).map(<[f32]>::to_vec).collect();
        let silhouettes = file.get("silhouette").unwrap().slice::<u32>().chunks(PIXELS);
        let silhouettes = silhouettes.map(|mask| mask.iter().map(|inside| *inside > 0).collect()).collect();
        (colours, silhouettes, file)
    }

    /// Features and layers of the built-in network against `tests/vectors/depth/network.py`, which shares nothing with it.
    #[test]
    fn layers_are_those_of_another_implementation() {
        let (colours, silhouettes, file) = vectors();
        let network = DepthNetwork::built_in().unwrap();
        let (features, layers) = (file.get("features").unwrap(), file.get("layers").unwrap());
        for (number, silhouette) in silhouettes.iter().enumerate() {
            let found = Features::of(std::array::from_fn(|k| &*colours[k]), silhouette);
            let wanted = &features.slice::<f32>()[number * CHANNELS * PIXELS..][..CHANNELS * PIXELS];
            assert!(found.planes.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-4));
            let said = network.forward(&[&found.planes]).unwrap().remove(0);
            let wanted = &layers.slice::<f32>()[4 * number * PIXELS..][..4 * PIXELS];
            for (plane, wanted) in said.iter().zip(wanted.chunks(PIXELS)) {
                for pixel in (0..PIXELS).filter(|pixel| silhouette[*pixel]) {
                    let wanted =
                        if wanted[pixel] < 0.0 { wanted[pixel].max(LOG_ERRORS[0] as f32) } else { wanted[pixel] };
                    assert!((plane[pixel] - wanted).abs() < 2e-3, "{} not {wanted}", plane[pixel]);
                }
            }
        }
    }

    /// A mirrored picture has the mirrored depths, for both are averaged.
    #[test]
    fn a_mirrored_picture_has_mirrored_depths() {
        let (colours, silhouettes, _) = vectors();
        let network = DepthNetwork::built_in().unwrap();
        let picture = |mirrored: bool| {
            let at = |pixel: usize| if mirrored { pixel / SIZE * SIZE + SIZE - 1 - pixel % SIZE } else { pixel };
            let colours = (0..PIXELS).map(|pixel| std::array::from_fn(|k| colours[k][at(pixel)])).collect();
            let coverage = (0..PIXELS).map(|pixel| f32::from(u8::from(silhouettes[0][at(pixel)]))).collect();
            MaskedPicture::new(SIZE, SIZE, colours, coverage).unwrap()
        };
        let [straight, turned] = [false, true].map(|mirrored| network.predict(&picture(mirrored)).unwrap());
        let mut front = turned.front.clone();
        mirror(&mut front);
        assert!(front.iter().zip(&straight.front).all(|(a, b)| (a - b).abs() < 1e-3));
        // all is within the silhouette, and deviations are in their range
        for pixel in 0..PIXELS {
            let [a, b] = [0, 1].map(|k| straight.deviations[k][pixel]);
            assert_eq!(straight.silhouette[pixel], a > 0.0 && b > 0.0);
            assert!(a < 4.0 && b < 4.0);
            assert!(straight.silhouette[pixel] || straight.front[pixel] == 0.0 && straight.back[pixel] == 0.0);
        }
        assert!(straight.at(-1.0, 5.0).is_none());
    }

    #[test]
    fn a_file_of_another_network_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("other.safetensors");
        let mut file = TensorFile::default();
        file.tensors.insert("weight".to_owned(), Tensor::from_vec(vec![1.0f32], [1]));
        file.write(&path).unwrap();
        let error = DepthNetwork::open(&path).unwrap_err();
        assert!(error.kind() == ErrorKind::Input && error.to_string().contains("gradreel.depth"), "{error}");
        // sizes without weights
        file.metadata.insert(DepthSizes::METADATA.to_owned(), DepthSizes::default().to_json());
        file.write(&path).unwrap();
        assert_eq!(DepthNetwork::open(&path).unwrap_err().kind(), ErrorKind::Input);
        assert!(DepthNetwork::open(folder.path().join("none")).is_err());
    }
}
