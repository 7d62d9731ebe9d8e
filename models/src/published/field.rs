//! One temporal field for all pictures of all frames.

use gradreel::io::TensorFile;
use gradreel::optim::Params;
use gradreel::{DType, ErrorKind, Result, Tape};

use super::{Path, PublishedConfig};
use crate::field::temporal::{ClipRays, TemporalField, TemporalFit, TemporalProgress};
use crate::render::ViewWeights;
use crate::report::animation::Picture;
use crate::runtime::run_folder::RunFolder;
use crate::vector::plus;
use crate::video::Clip;

/// File of the field in a run's folder.
pub(super) const FILE: &str = "temporal_field.safetensors";

/// Half the side of the field's box, in radii of the object.
const ROOM: f64 = 1.5;

/// Share of rays from the object's rectangle in a picture.
const OBJECT_SHARE: f64 = 0.7;

/// Updates between two savings.
const SAVE_EVERY: usize = 100;

/// Nodes at which the field is looked at for its motion.
const NODES: usize = 40_000;

/// Distance to the ground that counts as contact, in radii of the object.
const REACH: f64 = 0.08;

/// The pixels that a field is fitted to. Coordinates follow the object's path: the box of the field stays around it, and what the
/// deformation tells is how the object moves besides.
pub(super) struct Moving<'c> {
    pub rays: ClipRays<'c>,
    clip: &'c Clip,
    offsets: Vec<[f64; 3]>,
    corners: [[f64; 3]; 2],
    /// The object's largest radius \[m\].
    pub radius: f64,
}

/// Where a field has the object.
pub(super) struct FieldPath {
    pub middles: Vec<[f64; 3]>,
    pub lowest: Vec<f64>,
    pub contact: Option<usize>,
    pub velocity: Option<[f64; 3]>,
}

impl<'c> Moving<'c> {
    /// All pixels of a clip, whose imagined views count by their angles to the first real one.
    pub fn of(clip: &'c Clip, path: &Path, views: &ViewWeights) -> Self {
        let imagined: Vec<usize> = (0..clip.imagined.len()).filter(|&view| clip.imagined[view]).collect();
        let alpha = if imagined.is_empty() { 0.0 } else { views.alpha };
        let primary = clip.imagined.iter().position(|imagined| !imagined).unwrap_or(0);
        let [low, high] = path.bounds();
        let centre = [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]));
        let views = ViewWeights { alpha, ..views.clone() };
        let rays = ClipRays::new(clip, &views, centre, primary, &imagined, OBJECT_SHARE).following(path.offsets());
        let half = ROOM * path.largest();
        let corners = [path.places[0].map(|x| x - half), path.places[0].map(|x| x + half)];
        Self { rays, clip, offsets: path.offsets(), corners, radius: path.largest() }
    }

    /// A fit as its file in the folder has it, or a new one.
    ///
    /// # Errors
    /// [`ErrorKind::Input`] when the file belongs to other settings.
    pub fn fit(&self, config: &PublishedConfig, folder: &RunFolder) -> Result<TemporalFit> {
        let [low, high] = self.corners;
        let mut fit = TemporalFit::new(low, high, &config.sizes(), &config.fit(), DType::F32)?;
        if folder.has(FILE) {
            let place = folder.path(FILE);
            let file = TensorFile::from_bytes(&folder.read(FILE)?).map_err(|e| e.within(place.display()))?;
            fit.restore(&file).map_err(|e| e.within(place.display()))?;
            return Ok(fit);
        }
        fit.within_silhouettes(&self.rays)
    }

    /// Makes the updates that are missing, and keeps the file of the field up to date; `each` is called after every one, and its error,
    /// an interruption, leaves everything saved.
    ///
    /// # Errors
    /// What the updates and `each` return.
    pub fn go_on(
        &self,
        fit: &mut TemporalFit,
        folder: &RunFolder,
        each: &mut dyn FnMut(TemporalProgress) -> Result<()>,
    ) -> Result<()> {
        let saved = |fit: &TemporalFit| {
            let mut file = TensorFile::default();
            fit.save(&mut file);
            folder.write(FILE, &file.to_bytes()?)
        };
        while !fit.is_done() {
            let progress = fit.step(&self.rays)?;
            let outcome = each(progress);
            if outcome.is_err() || fit.is_done() || fit.iteration.is_multiple_of(SAVE_EVERY) {
                saved(fit)?;
            }
            outcome?;
        }
        Ok(())
    }

    /// The object's motion over a ground of this height \[m\]; nothing where the field is nowhere opaque in some frame.
    ///
    /// # Errors
    /// When the store holds no such field.
    pub fn motion(&self, fit: &TemporalFit, gravity: [f64; 3], ground: f64) -> Result<Option<FieldPath>> {
        let mut motion = match fit.field.motion(&fit.params, &self.rays.times, &self.clip.times, NODES) {
            Err(error) if error.kind() == ErrorKind::Input => return Ok(None),
            motion => motion?,
        };
        for (frame, offset) in self.offsets.iter().enumerate() {
            motion.centroids[frame] = plus(motion.centroids[frame], *offset);
            motion.lowest[frame] += offset[1];
        }
        let contact = motion.first_contact(ground, REACH * self.radius);
        let velocity = match motion.ballistic(gravity, contact.unwrap_or(self.clip.frame_count()).max(2)) {
            Err(error) if error.kind() == ErrorKind::Input => None,
            found => Some(found?.1),
        };
        Ok(Some(FieldPath { middles: motion.centroids, lowest: motion.lowest, contact, velocity }))
    }

    /// The field as these cameras see it in some frames, beside the pictures it was fitted to: a row a camera.
    ///
    /// # Errors
    /// When the store holds no such field.
    pub fn seen(&self, field: &TemporalField, params: &Params, cameras: &[usize], frames: &[usize]) -> Result<Picture> {
        let mut tiles = Vec::new();
        for &camera in cameras {
            for &frame in frames {
                let batch = self.rays.picture(camera, frame, DType::F32)?;
                let tape = Tape::new();
                let bound = params.bind(&tape);
                let seen = field.render(&bound, &batch.rays, &batch.moment_of, &self.rays.times)?;
                let pixels: Vec<f32> = seen.pixels.rgb.value()?.to_vec()?.into_iter().map(|x| x as f32).collect();
                let size = &self.clip.cameras[camera];
                let filmed: Vec<f32> = self.clip.frames[camera][frame].rgb.iter().copied().collect();
                tiles.push(Picture::from_unit(size.width, size.height, &filmed)?);
                tiles.push(Picture::from_unit(size.width, size.height, &pixels)?);
            }
        }
        Ok(Picture::grid(2 * frames.len(), &tiles))
    }
}
